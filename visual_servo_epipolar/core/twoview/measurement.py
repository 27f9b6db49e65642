"""
Measurement: heading, bearings, D and margins of one observation, with their deviations.

D alone is of the image plane: with a unit ray (x, y, z), |p|^2 = (x^2 + y^2) / z^2 = 1 / z^2 - 1.
It is taken over the features that both views have well in front; all else is of rays. |p|^2 has no
bound: through a ``wide`` lens a few features far off the axis would be all that counts, and they
tell least. There D is of the sphere, with 2 (1 - z), the square of the chord from the axis: at
small angles it is |p|^2, it grows as |p|^2 does when the camera comes closer, and every feature
counts by what it tells, one behind the camera as well.
"""

from dataclasses import dataclass, field, replace
import math
from typing import Any

import numpy as np

from visual_servo_epipolar.core.arrays import (
    are_among,
    BoolArray,
    FloatArray,
    median,
    packed,
    ROUNDING,
)
from visual_servo_epipolar.core.geometry.epipolar import Bearings, rotation_desired_current
from visual_servo_epipolar.core.geometry.lens import spurious_parallax
from visual_servo_epipolar.core.geometry.rays import dot, LEAST_FORWARD
from visual_servo_epipolar.core.geometry.rotation import RotationFit
from visual_servo_epipolar.core.twoview.estimator import UNKNOWN_COVARIANCE
from visual_servo_epipolar.core.twoview.memory import PerceptionMemory
from visual_servo_epipolar.core.twoview.observation import Observation
from visual_servo_epipolar.core.twoview.settings import PerceptionSettings
from visual_servo_epipolar.core.twoview.validation import ValidatedEstimate

APART, NEGLIGIBLE = 6.0, 5e-4  # times the median distance of features, plus rad
UNBOUNDED = (math.inf, math.inf)


@dataclass(frozen=True, eq=False)
class Measurement:
    """
    What one observation tells about the goal.

    Angles are in rad; times ``focal`` [px] they are pixels at the image centre. ``bearings`` is
    None where no estimate passed the validation gates, and ``reason`` says why. They are those of
    the cameras; where the camera does not sit on the axle they become those of the axle, and
    ``camera_bearings`` keeps the others. ``difference`` is D of eq. (23) at unit focal length,
    averaged over the features, ``difference_deviation`` its noise, ``difference_slope`` what a
    metre ahead adds to it, where a memory of views gives that; ``feature_error`` the median angle
    between current and desired features [rad]; ``parallax`` the angle that the best rotation
    leaves unexplained [rad]; ``heading_error`` [rad], left positive, comes from the bearings where
    there are any, else from that rotation, whose own is ``rotation_heading``. ``deviation`` is the
    larger one of psi and phi [rad], ``covariance`` that of both, shape (2, 2) [rad^2], ``jump``
    the change of tilt and roll between the views [rad]; ``view_margins`` is how far the robot may
    turn to the left and to the right before the features run out of the image [rad], by what a
    head can reach, and ``present_margins`` before they do so where the head is now; ``offset`` is
    where a memory of views has the camera, right and ahead of the goal's [m], None without one,
    with its deviation and that of the heading; ``noise_px`` the deviation of a tracked coordinate
    [px] as the residuals show it. ``rivals`` are the bearings, of either sign, of both geometries
    that fit before a plane, () where one is left: only motion tells them apart; ``bearings`` are
    then those that follow the last ones. ``remembered`` says that the bearings are those of a
    memory of views; ``carried`` that it is a measurement by it alone, where too few features are
    seen for two.
    """

    stamp_ns: int
    features: int
    focal: float
    noise_px: float
    bearings: Bearings | None = None
    camera_bearings: Bearings | None = None
    deviation: float = math.nan
    covariance: FloatArray = field(default_factory=lambda: UNKNOWN_COVARIANCE)
    jump: float = 0.0
    confidence: float = 0.0
    inliers: int = 0
    parallax: float = math.nan
    heading_error: float = math.nan
    rotation_heading: float = math.nan
    difference: float = math.nan
    difference_deviation: float = math.nan
    difference_slope: float = math.nan
    feature_error: float = math.nan
    view_margins: tuple[float, float] = UNBOUNDED
    present_margins: tuple[float, float] = UNBOUNDED
    offset: tuple[float, float] | None = None
    offset_deviation: float = math.nan
    heading_deviation: float = math.nan
    rivals: tuple[Bearings, ...] = ()
    remembered: bool = False
    carried: bool = False
    reason: str = ''

    @property
    def seen_bearings(self) -> Bearings | None:
        """The bearings of the cameras, which images show."""
        return self.camera_bearings or self.bearings

    def is_untrusted(self, near_parallax: float) -> bool:
        """Return whether no bearings are trusted, and the goal is not near or D unknown."""
        if self.bearings is not None:  # facing far away no feature counts in D
            return False
        return self.parallax > near_parallax or not math.isfinite(self.difference)

    @property
    def noise(self) -> float:
        """Deviation of the angle of a ray at the image centre [rad], as the residuals show it."""
        return self.noise_px / self.focal

    @property
    def parallax_px(self) -> float:
        """Parallax in pixels at the image centre."""
        return self.parallax * self.focal


def measured(
    observation: Observation,
    rotation: RotationFit,
    estimate: ValidatedEstimate,
    settings: PerceptionSettings,
) -> Measurement:
    """Return the measurement of one observation, by its best ``rotation`` and its ``estimate``."""
    geometry, quality, bearings = estimate.estimate, estimate.quality, estimate.bearings
    heading_error = rotation.heading_error if bearings is None else bearings.heading_error
    memory, counted = estimate.memory, usual_matches(observation, estimate)
    reach, present = margins(observation.current, counted, observation, settings.keep_features)
    of_fit: dict[str, Any] = {}
    if geometry is not None and quality is not None:
        of_fit = {
            'deviation': quality.deviation,
            'covariance': geometry.whole_covariance * quality.growth**2,
            'jump': geometry.jump,
            'confidence': geometry.confidence,
            'inliers': quality.inliers,
        }
    measurement = Measurement(
        observation.stamp_ns,
        len(observation),
        observation.focal,
        memory.noise,
        bearings=bearings,
        parallax=_parallax(observation, rotation, heading_error, memory, settings),
        heading_error=heading_error,
        rivals=estimate.rivals,
        rotation_heading=rotation.heading_error,
        feature_error=median(distances(observation.current, observation.desired)),
        view_margins=reach,
        present_margins=present,
        reason=estimate.reason,
        **of_fit,
    )
    if memory.two_view_skip:
        return measurement
    return measure_difference(measurement, observation, rotation, counted, memory, settings)


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


def measure_difference(
    measurement: Measurement,
    observation: Observation,
    rotation: RotationFit,
    counted: BoolArray,
    memory: PerceptionMemory,
    settings: PerceptionSettings,
) -> Measurement:
    """Return the ``measurement`` with D, of features turned as the goal where settings say so."""
    current, desired, wide = observation.current, observation.desired, observation.wide
    if settings.compensates:
        # Pitch and roll of an uneven floor are those of the best rotation, the heading is better.
        better = rotation_desired_current(measurement.heading_error - rotation.heading_error)
        level = current @ (better @ rotation.rotation).T
        difference = usual_difference(level, desired, wide, counted)
    else:
        difference = feature_difference(current, desired, wide)
    noise = memory.noise / observation.focal
    deviation = difference_deviation(current, desired, noise, wide)
    return replace(measurement, difference=difference, difference_deviation=deviation)


def feature_difference(
    current: FloatArray,
    desired: FloatArray,
    wide: bool = False,
    among: BoolArray | bool = True,
) -> float:
    """
    Return D = mean(|p_a|^2 - |p_d|^2) of rays, (N, 3) each (eq. 23); nan of none.

    Of a lens that is ``wide`` it is of the sphere. ``among``, (N,), says which are counted.
    """
    counted = _counted(current, desired, wide) & among
    if wide:
        change = 2.0 * (desired[:, 2] - current[:, 2])
    else:
        change = _squares(current) - _squares(desired)
    return float(np.where(counted, change, 0.0).sum()) / _count(counted)


def usual_difference(
    current: FloatArray, desired: FloatArray, wide: bool = False, among: BoolArray | bool = True
) -> float:
    """
    Return D of the rays, (N, 3) each, that are about as far off as most.

    ``among``, (N,), says which agree on one geometry: the others are not counted.
    """
    distance = distances(current, desired)
    usual = distance <= APART * median(distance) + NEGLIGIBLE
    return feature_difference(current, desired, wide, usual & among)


def difference_deviation(
    current: FloatArray, desired: FloatArray, noise: float, wide: bool = False
) -> float:
    """
    Return the deviation of D of rays, (N, 3) each.

    ``noise`` is that of image-plane coordinates of both views; of angles in a ``wide`` lens.
    """
    # Of |p_a|^2 - |p_d|^2, on the average of the features that are counted: 4 |p|^2 noise^2 each,
    # and of 2 (1 - z) 4 sin^2 noise^2.
    slopes = 1.0 - desired[:, 2] ** 2 if wide else _squares(desired)
    counted = _counted(current, desired, wide)
    return math.sqrt(8.0 * float(np.where(counted, slopes, 0.0).sum())) * noise / _count(counted)


def distances(current: FloatArray, desired: FloatArray) -> FloatArray:
    """Return the angles between rays, (N, 3), where they are small: shape (N,) [rad]."""
    offset = current - desired
    return np.sqrt(dot(offset, offset))


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
    if right - left >= 2.0 * np.pi - ROUNDING:
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


def _count(counted: BoolArray) -> float:
    """Return how many are ``counted``, nan of none."""
    return float(np.count_nonzero(counted)) or math.nan


def _counted(current: FloatArray, desired: FloatArray, wide: bool) -> BoolArray:
    """Return which features count for D, shape (N,): those in front, of a wide lens all."""
    if wide:
        return np.ones(len(current), bool)
    return np.asarray(np.minimum(current[:, 2], desired[:, 2]) > LEAST_FORWARD)


def _squares(rays: FloatArray) -> FloatArray:
    """Return |p|^2 of the image-plane points of ``rays`` in front, shape (N,)."""
    forward = np.maximum(rays[:, 2], LEAST_FORWARD)
    return np.asarray(1.0 / (forward * forward) - 1.0)
