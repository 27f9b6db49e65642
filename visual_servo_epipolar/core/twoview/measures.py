"""
Measures: quantities computed from features and a validated estimate, D of eq. (23) and margins.

D alone is of the image plane: with a unit ray (x, y, z), |p|^2 = (x^2 + y^2) / z^2 = 1 / z^2 - 1.
It is taken over the features that both views have well in front; all else is of rays. |p|^2 has no
bound: through a ``wide`` lens a few features far off the axis would be all that counts, and they
tell least. There D is of the sphere, with 2 (1 - z), the square of the chord from the axis: at
small angles it is |p|^2, it grows as |p|^2 does when the camera comes closer, and every feature
counts by what it tells, one behind the camera as well.
"""

import math
from typing import Any

import numpy as np

from visual_servo_epipolar.core.arrays import (
    are_among,
    BoolArray,
    FloatArray,
    median,
    medians,
    packed,
)
from visual_servo_epipolar.core.geometry.epipolar import rotation_desired_current
from visual_servo_epipolar.core.geometry.lens import spurious_parallax
from visual_servo_epipolar.core.geometry.rays import dot, LEAST_FORWARD
from visual_servo_epipolar.core.geometry.rotation import RotationFit
from visual_servo_epipolar.core.twoview.measurement import Measurement, UNBOUNDED
from visual_servo_epipolar.core.twoview.memory import PerceptionMemory
from visual_servo_epipolar.core.twoview.observation import Observation
from visual_servo_epipolar.core.twoview.settings import PerceptionSettings
from visual_servo_epipolar.core.twoview.validation import ValidatedEstimate

APART, NEGLIGIBLE = 6.0, 5e-4  # times the median distance of features, plus rad
FULL_CIRCLE = 2.0 * np.pi - 1e-6  # between the edges of an image [rad]


def measured(
    observation: Observation,
    rotation: RotationFit,
    estimate: ValidatedEstimate,
    settings: PerceptionSettings,
) -> Measurement:
    """Return the measurement of one observation, by its best ``rotation`` and its ``estimate``."""
    geometry, quality, bearings = estimate.estimate, estimate.quality, estimate.bearings
    heading_error = rotation.heading_error if bearings is None else bearings.heading_error
    counted = usual_matches(observation, estimate)
    keep = settings.keep_features
    reach, present = margins(observation.current, counted, observation, keep)
    known: dict[str, Any] = {}
    if geometry is not None and quality is not None:
        known = {
            'deviation': quality.deviation,
            'covariance': geometry.whole_covariance * quality.growth**2,
            'jump': geometry.jump,
            'confidence': geometry.confidence,
            'inliers': quality.inliers,
        }
    if not estimate.memory.two_view_skip:
        known |= differences(
            observation, rotation, heading_error, counted, estimate.memory, settings
        )
    return Measurement(
        observation.stamp_ns,
        len(observation),
        observation.focal,
        estimate.memory.noise,
        bearings=bearings,
        parallax=_parallax(observation, rotation, heading_error, estimate.memory, settings),
        heading_error=heading_error,
        rivals=estimate.rivals,
        rotation_heading=rotation.heading_error,
        feature_error=median(distances(observation.current, observation.desired)),
        view_margins=reach,
        present_margins=present,
        reason=estimate.reason,
        **known,
    )


def margins(
    current: FloatArray, counted: BoolArray, observation: Observation, keep: int
) -> tuple[tuple[float, float], tuple[float, float]]:
    """Return the margins of all that a head can reach, and of where it looks now."""
    edges, head = observation.edges, observation.head
    if head is None:
        return view_margins(current, counted, edges, keep), UNBOUNDED
    ahead = 0.5 * (edges[0] + edges[1])
    return (
        view_margins(current, counted, head.reach, keep, ahead),
        view_margins(current, counted, edges, keep, ahead),
    )


def usual_matches(observation: Observation, estimate: ValidatedEstimate) -> BoolArray:
    """Return which matches, (N,), are not known to be wrong."""
    if estimate.estimate is not None:
        return estimate.estimate.inliers
    wrong = estimate.memory.wrong
    if observation.ids is None or not wrong:
        return np.ones(len(observation), bool)
    return np.asarray(~are_among(observation.ids, np.array(wrong)))


def _parallax(
    observation: Observation,
    rotation: RotationFit,
    heading_error: float,
    memory: PerceptionMemory,
    settings: PerceptionSettings,
) -> float:
    """Return the parallax beyond what a lens that is not known may show in a turn."""
    if settings.calibrated:
        return rotation.parallax
    spurious = float(spurious_parallax(observation.desired, heading_error, memory.lens.root))
    return math.sqrt(max(rotation.parallax * rotation.parallax - spurious * spurious, 0.0))


def differences(
    observation: Observation,
    rotation: RotationFit,
    heading_error: float,
    counted: BoolArray,
    memory: PerceptionMemory,
    settings: PerceptionSettings,
) -> dict[str, float]:
    """Return D, of features turned as the goal is where settings say so, and its deviation."""
    current, desired, wide = observation.current, observation.desired, observation.wide
    if settings.compensates:
        # Pitch and roll of an uneven floor are those of the best rotation, the heading is better.
        better = rotation_desired_current(heading_error - rotation.heading_error)
        level = turned(current, better @ rotation.rotation)
        difference = usual_difference(level, desired, wide, counted)
    else:
        difference = feature_difference(current, desired, wide)
    noise = memory.noise / observation.focal
    deviation = difference_deviation(current, desired, noise, wide)
    return {'difference': float(difference), 'difference_deviation': float(deviation)}


def feature_difference(current: FloatArray, desired: FloatArray, wide: bool = False) -> FloatArray:
    """
    Return D = mean(|p_a|^2 - |p_d|^2), shape (...), of rays of shape (..., N, 3) (eq. 23).

    Of a lens that is ``wide`` it is of the sphere.
    """
    return _difference(current, desired, _counted(current, desired, wide), wide)


def usual_difference(
    current: FloatArray, desired: FloatArray, wide: bool = False, among: BoolArray | bool = True
) -> FloatArray:
    """
    Return D of the rays, (..., N, 3), that are about as far off as most, shape (...).

    ``among``, shape (..., N), says which agree on one geometry: the others are not counted.
    """
    distance = distances(current, desired)
    usual = (distance <= APART * medians(distance)[..., None] + NEGLIGIBLE) & among
    return _difference(current, desired, usual & _counted(current, desired, wide), wide)


def difference_deviation(
    current: FloatArray, desired: FloatArray, noise: float, wide: bool = False
) -> FloatArray:
    """
    Return the deviation of D, shape (...), of rays of shape (..., N, 3).

    ``noise`` is that of image-plane coordinates of both views; of angles in a ``wide`` lens.
    """
    counted = _counted(current, desired, wide)
    # Of |p_a|^2 - |p_d|^2, on the average of the features that are counted: 4 |p|^2 noise^2 each,
    # and of 2 (1 - z) 4 sin^2 noise^2.
    slopes = _squares(desired)
    if wide:
        slopes = 1.0 - desired[..., 2] ** 2
    squares = np.where(counted, slopes, 0.0).sum(axis=-1)
    return np.asarray(np.sqrt(8.0 * squares) * noise / _count(counted))


def distances(current: FloatArray, desired: FloatArray) -> FloatArray:
    """Return the angles between rays, (..., N, 3), where they are small: shape (..., N) [rad]."""
    offset = current - desired
    return np.sqrt(dot(offset, offset))


def turned(rays: FloatArray, rotation: FloatArray) -> FloatArray:
    """
    Return ``rays``, shape (..., N, 3), as a camera sees them that is turned by ``rotation``.

    ``rotation`` has shape (..., 3, 3). A heading error of 0.1 deg otherwise shifts the zero of D
    by centimetres, unless the features lie evenly to the left and right; a bump of 0.1 deg in the
    floor does so by millimetres.
    """
    return np.asarray(rays @ rotation.swapaxes(-1, -2))


def view_margins(
    current: FloatArray,
    counted: BoolArray,
    edges: tuple[float, float],
    keep: int,
    ahead: float | None = None,
) -> tuple[float, float]:
    """
    Return how far a camera may turn left and right until ``keep`` features remain [rad].

    ``current`` rays have shape (N, 3), and ``counted``, shape (N,), says which of them count;
    ``edges`` are the bearings of the left and the right edge of the image [rad], right positive.
    A camera that sees all round may turn without end; one that does not look ahead of the robot
    looks ``ahead`` [rad], and what it sees is within half a circle of that.
    """
    left, right = edges
    if right - left >= FULL_CIRCLE:
        return np.inf, np.inf
    bearings = np.arctan2(packed(current[:, 0]), packed(current[:, 2]))
    if ahead is not None:
        bearings = ahead + np.remainder(bearings - ahead + np.pi, 2.0 * np.pi) - np.pi
    ordered = bearings if counted.all() else bearings[counted]
    ordered.sort()
    keep = min(keep, len(ordered))
    if keep == 0:
        return 0.0, 0.0
    first, last = float(ordered[keep - 1]), float(ordered[len(ordered) - keep])
    return max(right - first, 0.0), max(last - left, 0.0)


def _difference(
    current: FloatArray, desired: FloatArray, counted: BoolArray, wide: bool
) -> FloatArray:
    """Return D over the features that are ``counted``, (..., N), shape (...); nan of none."""
    if wide:
        change = 2.0 * (desired[..., 2] - current[..., 2])
    else:
        change = _squares(current) - _squares(desired)
    squares = np.where(counted, change, 0.0)
    return np.asarray(squares.sum(axis=-1) / _count(counted))


def _count(counted: BoolArray) -> FloatArray:
    """Return how many are ``counted``, shape (..., N): (...), nan of none."""
    count = counted.sum(axis=-1)
    return np.asarray(np.where(count, count, np.nan))


def _counted(current: FloatArray, desired: FloatArray, wide: bool) -> BoolArray:
    """Return which features count for D, shape (..., N): those in front, of a wide lens all."""
    if wide:
        return np.ones(current.shape[:-1], bool)
    return np.asarray(np.minimum(current[..., 2], desired[..., 2]) > LEAST_FORWARD)


def _squares(rays: FloatArray) -> FloatArray:
    """Return |p|^2 of the image-plane points of ``rays`` in front, shape (..., N)."""
    forward = np.maximum(rays[..., 2], LEAST_FORWARD)
    return np.asarray(1.0 / (forward * forward) - 1.0)
