"""
Tied views: photographs of one pose in different light, their pixels tied to the first one's.

Features are tracked in the photograph that fits the light, but lead to where the first one was
taken: their pixels are mapped to it, by what both photographs show.
"""

from dataclasses import dataclass, replace

import numpy as np

from visual_servo_epipolar.core.arrays import FloatArray, IntArray
from visual_servo_epipolar.core.errors import TrackingError
from visual_servo_epipolar.core.geometry.rays import homogeneous
from visual_servo_epipolar.core.tracking.alignment.sampling import float_image, inside_border
from visual_servo_epipolar.core.tracking.alignment.template_alignment import Anchor
from visual_servo_epipolar.core.tracking.alignment.warps import squared_lengths, Warps
from visual_servo_epipolar.core.tracking.features import Features
from visual_servo_epipolar.core.tracking.matching import (
    BORDER,
    DesiredView,
    match,
    warps_of,
)
from visual_servo_epipolar.core.tracking.tracks import (
    fit_motion,
    ImageMotion,
    OUTLIER_MEDIANS,
    Tracks,
)

ITERATIONS = 15  # of the alignment of one photograph with the other
MIN_CORRELATION = 0.7  # of a patch in both: in other light edges stay, shading does not
MIN_COMMON = 30  # features in both photographs
# Of two photographs of one pose, over the width of the image: 2 to 3 deg, and 1 to 2 cm in a room.
MAX_SHIFT, MAX_PARALLAX = 0.04, 0.0015
ONE_PLACE = 0.00015  # parallax within a millimetre or two: features move smoothly
OUTLIER_PX = 2.0
NEAR_PX = 8.0  # distance from a feature within which others move as it does
REMEDY = 'take it where the first one was taken, best when the robot has arrived there'


@dataclass(frozen=True, slots=True, eq=False)
class TiedView:
    """
    A photograph to track: its ``view`` and ``anchor``, and what ties it to the first of its goal.

    Its N keypoints lie at ``first_pixels``, shape (N, 2), in the first photograph, and their ids
    begin with ``first_id``.
    """

    view: DesiredView
    anchor: Anchor
    first_pixels: FloatArray
    first_id: int = 0

    @classmethod
    def first(cls, view: DesiredView) -> 'TiedView':
        """Return the photograph that defines the goal."""
        return cls(view, Anchor(view.image), view.keypoints.pixels)

    def features(self, tracks: Tracks, goal: int) -> Features:
        """Return the features of a ``goal`` that ``tracks`` of this view are."""
        warps = tracks.warps
        ids, desired = warps.ids, warps.desired
        if self.first_id:
            ids, desired = ids + self.first_id, self.first_pixels[ids]
        canvas = self.view.canvas
        return Features(
            ids,
            canvas.pixels_of_image(warps.current),
            canvas.pixels_of_image(desired),
            tracks.ages,
            tracks.residuals,
            goal,
        )


def tied(view: DesiredView, first: TiedView, first_id: int) -> TiedView:
    """
    Return ``view``, with ids from ``first_id`` on, tied to the ``first`` photograph of its goal.

    Raises ValueError if it is of another size, and TrackingError if it does not show what the
    first one does, or from another place.
    """
    shape = first.view.image.shape
    if view.image.shape != shape:
        raise ValueError(
            f'a further photograph must have the size of the first, {shape[1]}x{shape[0]}, got '
            f'{view.image.shape[1]}x{view.image.shape[0]}; take both with one camera'
        )
    anchor = Anchor(view.image)
    rows, pixels = _mapped(view, _common(view, anchor, first))
    shown = inside_border(pixels, shape, anchor.radius + BORDER)
    rows, pixels = rows[shown], pixels[shown]
    view = replace(view, keypoints=view.keypoints.take(rows), corners=view.corners[rows])
    return TiedView(view, anchor, pixels, first_id)


def _common(view: DesiredView, anchor: Anchor, first: TiedView) -> Warps:
    """Return the warps of the features of ``view`` that the ``first`` photograph shows as well."""
    image = first.view.image
    try:
        matches = match(view, image)
    except TrackingError:
        raise TrackingError(
            f'the photograph does not show what the first one of this goal does; {REMEDY}'
        ) from None
    warps = warps_of(matches, view)
    alignment = anchor.align(warps, float_image(image), iterations=ITERATIONS)
    return alignment.warps.take(alignment.correlation >= MIN_CORRELATION)


def _mapped(view: DesiredView, common: Warps) -> tuple[IntArray, FloatArray]:
    """
    Return the keypoints of ``view`` that can be tied, (M,), and where the first has them, (M, 2).

    All, as what is common moves around each, where photographs of one place leave nothing else;
    otherwise those that both show, where each was found. Raises TrackingError if the places are
    too far apart.
    """
    width = view.image.shape[1]
    common, motion = _agreed(common)
    off = np.hypot(*(common.current - motion.applied(common.desired)).T)
    shift = float(np.median(np.hypot(*(common.current - common.desired).T)))
    parallax = float(np.median(off))
    if shift > MAX_SHIFT * width or parallax > MAX_PARALLAX * width:
        raise TrackingError(
            f'the photograph was taken from another pose than the first one of this goal: '
            f'features are shifted by {shift:.1f} px, at most {MAX_SHIFT * width:.1f} are '
            f'allowed, and by {parallax:.2f} px against those around them, at most '
            f'{MAX_PARALLAX * width:.2f}; {REMEDY}'
        )
    if parallax <= ONE_PLACE * width:
        pixels = view.keypoints.pixels
        return np.arange(len(pixels)), _moved_alike(pixels, common, motion)
    kept = off <= OUTLIER_PX + OUTLIER_MEDIANS * parallax
    return common.ids[kept], common.current[kept]


def _moved_alike(pixels: FloatArray, common: Warps, motion: ImageMotion) -> FloatArray:
    """
    Return where the first photograph has ``pixels``, shape (N, 2), of the other one.

    The affine part of the ``motion``, and what is ``common`` nearby: a smoother map would take
    parallax of a millimetre out of the pixels, and lead the robot to the other place.
    """
    squared = squared_lengths(pixels)[:, None] - 2.0 * pixels @ common.desired.T
    squared += squared_lengths(common.desired)
    weight = (np.maximum(squared, 0.0) + NEAR_PX**2) ** -2.0
    local = (weight @ motion.residuals) / weight.sum(axis=1, keepdims=True)
    return np.asarray(homogeneous(pixels) @ motion.affine + local)


def _agreed(common: Warps) -> tuple[Warps, ImageMotion]:
    """Return what moves alike from a photograph to the first, and how; TrackingError of few."""
    motion = fit_motion(common.desired, common.current)
    if motion is not None:
        common = common.take(~motion.outliers(common.desired, common.current, OUTLIER_PX))
        motion = fit_motion(common.desired, common.current)
    if motion is None or len(common) < MIN_COMMON:
        raise TrackingError(
            f'the photograph has {len(common)} features in common with the first one of this '
            f'goal, at least {MIN_COMMON} are needed; {REMEDY}, or in light between both'
        )
    return common, motion
