"""
Auxiliary features: corners that the photograph does not show, from frame to frame.

Nothing anchors them: what optical flow is off by adds up, so the old are let go, one at a time
and while the photograph's features are in view. A memory of views learns where they are, for when
those are not.
"""

import math
from zlib import crc32

import cv2
import numpy as np

from visual_servo_epipolar.core.arrays import BoolArray, FloatArray, Image
from visual_servo_epipolar.core.tracking.alignment.sampling import inside_border
from visual_servo_epipolar.core.tracking.canvas import Canvas, PLANE
from visual_servo_epipolar.core.tracking.features import (
    AuxiliaryFeatures,
    FIRST_AUXILIARY,
    NO_AUXILIARY,
)
from visual_servo_epipolar.core.tracking.flow import flow, Frame
from visual_servo_epipolar.core.tracking.settings import TrackerSettings

PERIOD = 5  # frames between two looks for new ones
OLD = 300  # frames, after which drift may be a pixel
QUALITY = 0.01  # of a corner, of the best one's (Shi and Tomasi 1994)
SPACING = 0.4  # least distance from each other, of what it is where they are spread evenly
TWIN_PX = 5.0  # from a feature of the photograph: it may be the same
BORDER = 12.0  # nearer to the border of the image they are soon gone [px]
LAST_ID = (1 << 32) - 1  # that a row of ``tracks`` can hold


class AuxiliaryTracker:
    """Auxiliary features of a stream of images, at most as many as the settings say."""

    def __init__(self) -> None:
        self.features = NO_AUXILIARY
        self._next_id: int | None = None
        self._frame = 0

    def forget(self) -> None:
        """Forget those that are followed: the next image has nothing to do with the last."""
        self.features = NO_AUXILIARY

    def follow(
        self,
        previous: Frame | None,
        frame: Frame,
        known: FloatArray,
        settings: TrackerSettings,
        canvas: Canvas = PLANE,
    ) -> AuxiliaryFeatures:
        """Return the auxiliary features in a ``frame``, none near the ``known`` pixels, (N, 2)."""
        limit = settings.auxiliary_features
        if limit == 0:
            self.features = NO_AUXILIARY
            return self.features
        self._frame += 1
        followed = NO_AUXILIARY
        if previous is not None and len(self.features):
            followed = self._followed(previous, frame, known, settings)
        if self._frame % PERIOD == 1:
            if len(known) >= settings.min_features:
                followed = _without_oldest(followed)
            followed = self._with_new(followed, frame.image, known, limit - len(followed))
        self.features = canvas.own_auxiliary(followed)
        return self.features

    def _followed(
        self, previous: Frame, frame: Frame, known: FloatArray, settings: TrackerSettings
    ) -> AuxiliaryFeatures:
        before, ages = self.features, self.features.ages + 1
        points = before.current.astype(np.float32)
        after, valid = flow(
            previous, frame, points, settings=settings, coarse=True, both_ways=True
        )
        current = after.astype(np.float64)
        valid &= inside_border(current, frame.image.shape, BORDER)
        valid &= ~_near(current, known)
        return AuxiliaryFeatures(before.ids[valid], current[valid], ages[valid])

    def _with_new(
        self, auxiliary: AuxiliaryFeatures, image: Image, known: FloatArray, missing: int
    ) -> AuxiliaryFeatures:
        if missing <= 0:
            return auxiliary
        # Spread, and where the photograph's are not: what hides those may leave these.
        spacing = SPACING * math.sqrt(image.size / (len(auxiliary) + missing))
        mask = np.full(image.shape, 255, np.uint8)
        for points, radius in ((known, 0.5 * spacing), (auxiliary.current, spacing)):
            for u, v in points.round().astype(int).tolist():
                cv2.circle(mask, (u, v), round(radius), 0, -1)
        corners = cv2.goodFeaturesToTrack(image, missing, QUALITY, spacing, mask=mask)
        if corners is None:
            return auxiliary
        found = corners.reshape(-1, 2).astype(np.float64)
        found = found[inside_border(found, image.shape, BORDER)]
        first = _first_id(image) if self._next_id is None else self._next_id
        first = first if first + len(found) <= LAST_ID else FIRST_AUXILIARY
        ids = first + np.arange(len(found))
        self._next_id = first + len(found)
        return AuxiliaryFeatures(
            np.concatenate([auxiliary.ids, ids]),
            np.concatenate([auxiliary.current, found]),
            np.concatenate([auxiliary.ages, np.zeros(len(found), np.int64)]),
        )


def _first_id(image: Image) -> int:
    """
    Return the id to begin with: another one in another stream.

    A tracker that begins anew must not give the ids that a memory has from the one before.
    """
    return FIRST_AUXILIARY + crc32(image[::8, ::8].tobytes()) % (LAST_ID // 2)


def _without_oldest(auxiliary: AuxiliaryFeatures) -> AuxiliaryFeatures:
    """Return the features without the oldest one, if that is old."""
    if not len(auxiliary) or int(auxiliary.ages.max()) < OLD:
        return auxiliary
    return auxiliary.take(np.arange(len(auxiliary)) != int(auxiliary.ages.argmax()))


def _near(points: FloatArray, known: FloatArray) -> BoolArray:
    """Return which points, (M, 2), stand where a feature of the photograph is seen."""
    if not len(known) or not len(points):
        return np.zeros(len(points), bool)
    offset = points[:, None] - known
    least = np.min((offset * offset).sum(-1), axis=1)
    return np.asarray(least < TWIN_PX**2)
