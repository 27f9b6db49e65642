"""
The tracker: which feature of the desired view is where in the current image.

Pyramidal Lucas-Kanade from frame to frame with a forward-backward check keeps the features; each
is then anchored to its patch in the desired image, so that small errors do not add up to drift.
When too few are left the whole image is matched anew.
"""

from dataclasses import dataclass, replace
from typing import TypeAlias

import cv2
import numpy as np
from numpy.typing import NDArray

from visual_servo_epipolar.core.anchoring import Anchor, Warps
from visual_servo_epipolar.core.arrays import as_gray, BoolArray, FloatArray, Image, IntArray
from visual_servo_epipolar.core.errors import TrackingError
from visual_servo_epipolar.core.features import Features
from visual_servo_epipolar.core.matching import desired_view, DesiredView, match, spread
from visual_servo_epipolar.core.settings import setting, Settings

FIRST_ITERATIONS = 15  # of the alignment after a match: its scale is only known by SIFT
BORDER = 4.0

Points: TypeAlias = NDArray[np.float32]  # as OpenCV's flow wants them, shape (N, 2)


@dataclass(frozen=True, kw_only=True)
class TrackerSettings(Settings):
    """How many features, how carefully they are tracked, when they are given up."""

    max_features: int = setting(60, 'Features tracked at a time', low=8, high=1000)
    min_features: int = setting(
        40, 'Features below which the image is matched anew', low=0, high=1000
    )
    rematch_period: int = setting(
        11, 'Least number of frames between two matchings', low=1, high=10000
    )
    window: int = setting(21, 'Side of the Lucas-Kanade window [px]', low=5, high=101)
    levels: int = setting(4, 'Pyramid levels above the full image', low=0, high=8)
    forward_backward: float = setting(
        1.0, 'Largest forward-backward distance [px]', low=0.01, high=20.0
    )
    anchor_period: int = setting(
        1, 'Frames between two alignments with the desired image; 0 = never', low=0, high=1000
    )
    anchor_iterations: int = setting(4, 'Iterations of an alignment', low=1, high=50)
    min_correlation: float = setting(
        0.75, 'Correlation with the desired patch to be kept', low=0.0, high=1.0
    )
    overlay: bool = setting(True, 'Publish the image with features drawn on it')

    def __post_init__(self) -> None:
        super().__post_init__()
        if self.min_features > self.max_features:
            raise ValueError(
                f'min_features must not exceed max_features, got {self.min_features} and '
                f'{self.max_features}'
            )


@dataclass(frozen=True, slots=True, eq=False)
class _Tracked:
    """What is tracked now; ages [frames] and residuals [grey levels], shape (N,)."""

    warps: Warps
    ages: IntArray
    residuals: FloatArray

    def take(self, rows: IntArray | BoolArray) -> '_Tracked':
        return _Tracked(self.warps.take(rows), self.ages[rows], self.residuals[rows])


class Tracker:
    """
    Tracks the features of one desired image through a stream of current images.

    ``track`` returns no features before ``set_desired``. The id of a feature is its number in the
    desired view and never changes; a feature that was lost may come back under its id.
    """

    def __init__(self, settings: TrackerSettings) -> None:
        self.settings = settings
        self._view: DesiredView | None = None
        self._anchor: Anchor | None = None
        self._previous: Image | None = None
        self._tracked = _nothing()
        self._frame = 0
        self._match_frame: int | None = None
        self.reason = 'no desired image yet'

    @property
    def has_desired(self) -> bool:
        """Whether there is a photograph to come back to."""
        return self._view is not None

    def set_desired(self, image: Image) -> None:
        """
        Take ``image`` as the desired view and forget all features.

        Raises ValueError or TrackingError, and keeps the view it had, if it cannot be used.
        """
        view = desired_view(image)
        self._view, self._anchor = view, Anchor(view.image)
        self.redetect()

    def redetect(self) -> None:
        """Forget all features; the next image is matched to the desired one anew."""
        self._previous, self._tracked, self._match_frame = None, _nothing(), None

    def track(self, image: Image) -> Features:
        """
        Return the features of the desired view seen in ``image``, uint8 of shape (H, W).

        Raises
        ------
        ValueError
            If ``image`` is not uint8 grey, or not as large as the desired one.

        """
        image = as_gray(image)
        if self._view is None or self._anchor is None:
            return Features()
        if image.shape != self._view.image.shape:
            raise ValueError(
                f'image must have the size of the desired one, {_size(self._view.image)}, got '
                f'{_size(image)}; take both with the same camera and resolution'
            )
        self._frame += 1
        tracked = self._followed(image)
        if self._anchors_now:
            tracked = self._align(tracked, image, self.settings.anchor_iterations)
        if len(tracked.warps) < self.settings.min_features and self._may_match():
            tracked = self._replenished(tracked, image)
        self._tracked, self._previous = tracked, image
        return self._features()

    def _may_match(self) -> bool:
        last = self._match_frame
        return last is None or self._frame - last >= self.settings.rematch_period

    @property
    def _anchors_now(self) -> bool:
        period = self.settings.anchor_period
        return period > 0 and self._frame % period == 0

    def _followed(self, image: Image) -> _Tracked:
        """
        Follow the features from the last image by Lucas-Kanade.

        Checked backward as well, except where the desired patch will judge the result anyway.
        """
        if self._previous is None or not len(self._tracked.warps):
            return _nothing()
        before = self._tracked.warps.current.astype(np.float32)
        after, found = self._flow(self._previous, image, before, None)
        if not self._anchors_now:
            back, found_back = self._flow(image, self._previous, after, before)
            found &= found_back & (np.hypot(*(back - before).T) <= self.settings.forward_backward)
        warps = replace(self._tracked.warps, current=after.astype(np.float64))
        good = found & _inside(warps.current, image)
        moved = replace(self._tracked, warps=warps, ages=self._tracked.ages + 1)
        return moved.take(good)

    def _flow(
        self, source: Image, target: Image, points: Points, guess: Points | None
    ) -> tuple[Points, BoolArray]:
        moved, status, _ = cv2.calcOpticalFlowPyrLK(
            source,
            target,
            points,
            None if guess is None else guess.copy(),
            winSize=(self.settings.window, self.settings.window),
            maxLevel=self.settings.levels,
            criteria=(cv2.TERM_CRITERIA_COUNT + cv2.TERM_CRITERIA_EPS, 20, 0.01),
            flags=0 if guess is None else cv2.OPTFLOW_USE_INITIAL_FLOW,
        )
        return moved, np.asarray(status.ravel() > 0)

    def _align(self, tracked: _Tracked, image: Image, iterations: int) -> _Tracked:
        assert self._anchor is not None
        alignment = self._anchor.align(tracked.warps, image, iterations=iterations)
        aligned = _Tracked(alignment.warps, tracked.ages, alignment.residual)
        good = alignment.correlation >= self.settings.min_correlation
        return aligned.take(good & _inside(alignment.warps.current, image))

    def _replenished(self, tracked: _Tracked, image: Image) -> _Tracked:
        """Match the whole image with the desired one and fill up with new features."""
        assert self._view is not None
        self._match_frame = self._frame
        try:
            matches = match(self._view, image)
        except TrackingError as error:
            self.reason = str(error)
            return tracked
        self.reason = ''
        fresh = ~np.isin(matches.indices, tracked.warps.ids)
        new = _Tracked(
            Warps(
                matches.indices[fresh],
                self._view.keypoints.pixels[matches.indices[fresh]],
                matches.pixels[fresh],
                matches.scales[fresh, None, None] * np.eye(2),
            ),
            np.zeros(int(fresh.sum()), np.int64),
            np.zeros(int(fresh.sum())),
        )
        return self._chosen(tracked, self._align(new, image, FIRST_ITERATIONS))

    def _chosen(self, kept: _Tracked, new: _Tracked) -> _Tracked:
        """Return what is kept and the best of the new, spread over the desired image."""
        assert self._view is not None
        both = _Tracked(
            kept.warps.joined(new.warps),
            np.concatenate([kept.ages, new.ages]),
            np.concatenate([kept.residuals, new.residuals]),
        )
        height, width = self._view.image.shape
        quality = self._view.corners[both.warps.ids]
        quality[: len(kept.warps)] += (
            self._view.corners.max()
        )  # what is tracked already comes first
        rows = spread(both.warps.desired, quality, self.settings.max_features, (width, height))
        return both.take(rows)

    def _features(self) -> Features:
        warps = self._tracked.warps
        return Features(
            warps.ids, warps.current, warps.desired, self._tracked.ages, self._tracked.residuals
        )


def _nothing() -> _Tracked:
    empty = np.empty((0, 2))
    warps = Warps(np.empty(0, np.int64), empty, empty, np.empty((0, 2, 2)))
    return _Tracked(warps, np.empty(0, np.int64), np.empty(0))


def _inside(pixels: FloatArray, image: Image) -> BoolArray:
    height, width = image.shape
    u, v = pixels[:, 0], pixels[:, 1]
    inside = (u >= BORDER) & (u < width - BORDER) & (v >= BORDER) & (v < height - BORDER)
    return np.asarray(inside)


def _size(image: Image) -> str:
    return f'{image.shape[1]}x{image.shape[0]}'
