"""Matching of the desired with a current image: pairs of a matcher, one epipolar geometry."""

from contextlib import suppress
from dataclasses import dataclass
import math

import cv2
import numpy as np

from visual_servo_epipolar.core.arrays import as_gray, FloatArray, Image, IntArray, TINY
from visual_servo_epipolar.core.errors import TrackingError
from visual_servo_epipolar.core.geometry.epipolar import MIN_MATCHES
from visual_servo_epipolar.core.geometry.significance import log_false_alarms
from visual_servo_epipolar.core.tracking.canvas import Canvas, PLANE
from visual_servo_epipolar.core.tracking.matchers.base import Keypoints, Matcher, NEIGHBOURS
from visual_servo_epipolar.core.tracking.matchers.sift import SIFT
from visual_servo_epipolar.core.tracking.sampling import (
    COMPARED,
    inside_border,
    noise,
    patch_radius,
)
from visual_servo_epipolar.core.tracking.warps import Warps

CORNER_WINDOW = 15  # side of the window of the corner measure [px]
BORDER = 2  # so much farther than a patch's radius from the border of the desired image [px]
LIMIT = 4000  # of keypoints of an image
CHANCE = -2.0  # log10 of the false alarms of a geometry that are expected at most


@dataclass(frozen=True, slots=True, eq=False)
class DesiredView:
    """
    Desired view: the photograph to come back to.

    ``image``, uint8 of shape (H, W); its N ``keypoints``, found by the ``matcher``; ``corners``,
    shape (N,), the smaller eigenvalue of the gradient matrix around each (Shi and Tomasi 1994),
    summed [grey levels^2 / px^2]; ``noise`` of the image [grey levels].
    """

    image: Image
    keypoints: Keypoints
    corners: FloatArray
    noise: float
    matcher: Matcher
    canvas: Canvas = PLANE

    @property
    def deviations(self) -> FloatArray:
        """Deviation of each keypoint by noise, of this image and of another, shape (N,) [px]."""
        corners = np.maximum(self.corners, TINY)  # those of a wall
        return np.asarray(self.noise * math.sqrt(2.0) / np.sqrt(corners))


@dataclass(frozen=True, slots=True, eq=False)
class Matches:
    """
    Matches of a desired view with a current image, rows are matches.

    ``indices``, shape (M,), into the keypoints of the view; ``pixels``, shape (M, 2), in the
    current image; ``scales``, shape (M,), size in the current over size in the desired image.
    """

    indices: IntArray
    pixels: FloatArray
    scales: FloatArray


def desired_view(
    image: Image, matcher: Matcher = SIFT, *, limit: int = LIMIT, canvas: Canvas = PLANE
) -> DesiredView:
    """
    Return the desired view of ``image``, with at most ``limit`` keypoints of a ``matcher``.

    It is painted on the ``canvas``, in whose pixels everything is. Raises ValueError if it is not
    uint8 of shape (H, W), or larger than OpenCV can sample, and TrackingError if it shows fewer
    than eight features: a blank wall, a lens cap.
    """
    image = canvas.painted(as_gray(image, 'desired image').copy())
    limit_px = np.iinfo(np.int16).max  # of cv2.remap
    if max(image.shape) >= limit_px:
        raise ValueError(
            f'desired image must have sides of at most {limit_px - 1} px, got '
            f'{image.shape[1]}x{image.shape[0]}; take a smaller one'
        )
    border = patch_radius(image.shape) + BORDER
    keypoints = matcher.describe(image, limit=limit, border=border)
    shown = inside_border(keypoints.pixels, image.shape, border) & canvas.owns(keypoints.pixels)
    shown &= canvas.shows(keypoints.pixels)
    keypoints = keypoints.take(shown)
    if len(keypoints) < MIN_MATCHES:
        raise TrackingError(
            f'the desired image shows {len(keypoints)} features, at least {MIN_MATCHES} are '
            'needed; take the photograph where there is texture and light'
        )
    return view_of_keypoints(image, keypoints, matcher, canvas)


def view_of_keypoints(
    image: Image, keypoints: Keypoints, matcher: Matcher = SIFT, canvas: Canvas = PLANE
) -> DesiredView:
    """Return the desired view of an ``image`` on a ``canvas`` whose ``keypoints`` are known."""
    measure = cv2.cornerMinEigenVal(image, CORNER_WINDOW, ksize=3)
    columns, rows = np.rint(keypoints.pixels).astype(int).T
    scale = (0.5 * CORNER_WINDOW * np.iinfo(np.uint8).max) ** 2  # OpenCV's measure is no sum
    corners = scale * measure[rows, columns].astype(np.float64)
    return DesiredView(image, keypoints, corners, noise(image), matcher, canvas)


class CurrentView:
    """Current view: an image on its canvas, (H, W), whose keypoints are detected but once."""

    def __init__(self, image: Image) -> None:
        self._image = as_gray(image)
        self._detected: dict[tuple[object, bool], Keypoints] = {}

    def keypoints(self, view: DesiredView, *, quick: bool) -> Keypoints:
        """Return the keypoints to be paired with those of ``view``; views share one matcher."""
        key = view.keypoints.tuning, quick
        if key not in self._detected:
            keypoints = view.matcher.detect(
                self._image, view.keypoints.tuning, limit=LIMIT, quick=quick
            )
            own = view.canvas.owns(keypoints.pixels) & view.canvas.shows(keypoints.pixels)
            self._detected[key] = keypoints if own.all() else keypoints.take(own)
        return self._detected[key]


def match(view: DesiredView, image: Image | CurrentView, *, quick: bool = False) -> Matches:
    """
    Find the keypoints of ``view`` in ``image``.

    Pairs of the view's matcher, then one robust epipolar geometry that all must fit, and more of
    them than by chance. ``image`` is uint8 of shape (H, W), or a view of it for several matches;
    ``quick`` gives fewer matches in less time. Raises TrackingError if fewer than eight matches
    agree on one epipolar geometry, or no more than those of another place would.
    """
    image = image if isinstance(image, CurrentView) else CurrentView(image)
    keypoints = image.keypoints(view, quick=quick)
    pairs = view.matcher.pairs(view.keypoints, keypoints)
    desired, current = view.keypoints.take(pairs[:, 0]), keypoints.take(pairs[:, 1])
    geometry, inliers = view.canvas.geometry(current.pixels, desired.pixels)
    if geometry is None or int(inliers.sum()) < MIN_MATCHES:
        raise TrackingError(
            f'the photograph is not seen from here: {len(pairs)} matches of which '
            f'{int(inliers.sum())} agree on one geometry, {MIN_MATCHES} needed; turn the robot '
            'towards it'
        )
    frames = _frames(current, view.canvas), _frames(desired, view.canvas)
    if log_false_alarms(geometry, *frames, inliers) > CHANCE:
        raise TrackingError(
            f'the photograph is not seen from here: {int(inliers.sum())} of {len(pairs)} matches '
            'agree on one geometry, no more than by chance; turn the robot towards it, or take a '
            'photograph of this place'
        )
    return Matches(
        pairs[inliers, 0],
        current.pixels[inliers],
        _scales(current.take(inliers), desired.take(inliers)),
    )


def _scales(current: Keypoints, desired: Keypoints) -> FloatArray:
    """Return the size in the current over that in the desired image of each match, shape (N,)."""
    if np.ptp(current.sizes) or np.ptp(desired.sizes):
        return np.asarray(current.sizes / desired.sizes)
    # Sizes are not known: as much as the distances from matches around it.
    few = np.arange(0, len(current), max(len(current) // COMPARED, 1))
    before, after = (
        np.linalg.norm(each[:, None] - each[few], axis=2)
        for each in (desired.pixels, current.pixels)
    )
    near = np.argsort(before + (before == 0.0) * before.max(), axis=1)[:, :NEIGHBOURS]
    before, after = (np.take_along_axis(each, near, axis=1) for each in (before, after))
    return np.asarray(np.median(after / np.maximum(before, 1.0), axis=1))


def _frames(keypoints: Keypoints, canvas: Canvas) -> FloatArray:
    """Return pixel or ray, angle [rad] and logarithm of the size of each, (N, 4) or (N, 5)."""
    points = canvas.points(keypoints.pixels)
    return np.column_stack([points, keypoints.angles, np.log2(keypoints.sizes)])


def warps_of(matches: Matches, view: DesiredView) -> Warps:
    """Return the warps of keypoints of ``view`` that its ``matches`` are, to be aligned yet."""
    ids, affine = matches.indices, matches.scales[:, None, None] * np.eye(2)
    return Warps(ids, view.keypoints.pixels[ids], matches.pixels, affine)


def match_as_needed(view: DesiredView, image: CurrentView, enough: int | None) -> Matches:
    """
    Match quickly where that gives ``enough`` matches, None of none, and otherwise with care.

    Raises TrackingError as ``match``.
    """
    if enough is not None:
        with suppress(TrackingError):
            matches = match(view, image, quick=True)
            if len(matches.indices) >= enough:
                return matches
    return match(view, image)
