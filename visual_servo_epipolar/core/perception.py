"""From matched features to what the servo acts on: bearings, parallax, rotation, D."""

from dataclasses import dataclass, field, replace
import math

import numpy as np

from visual_servo_epipolar.core.arrays import FloatArray, frozen
from visual_servo_epipolar.core.camera import Camera
from visual_servo_epipolar.core.epipolar import (
    Bearings,
    homogeneous,
    rotation_desired_current,
    sampson_distance,
)
from visual_servo_epipolar.core.errors import DegenerateGeometryError
from visual_servo_epipolar.core.estimators.base import (
    Estimate,
    Estimator,
    Prior,
    UNKNOWN_COVARIANCE,
)
from visual_servo_epipolar.core.estimators.lmeds_8pt import lmeds_8pt
from visual_servo_epipolar.core.estimators.planar_2dof import planar_2dof
from visual_servo_epipolar.core.estimators.planar_3dof import planar_3dof
from visual_servo_epipolar.core.estimators.soft_planar import soft_planar
from visual_servo_epipolar.core.features import Features
from visual_servo_epipolar.core.homography import fit_rotation
from visual_servo_epipolar.core.motion import HALF_PI
from visual_servo_epipolar.core.servo_settings import ServoSettings
from visual_servo_epipolar.core.trust import (
    deviation,
    doubt,
    fresh_memory,
    Memory,
    remembered,
)

ESTIMATORS: dict[str, Estimator] = {
    'lmeds_8pt': lmeds_8pt,
    'planar_3dof': planar_3dof,
    'planar_2dof': planar_2dof,
    'soft_planar': soft_planar,
}
APART, NEGLIGIBLE = 6.0, 5e-4  # times the median distance of features, plus rad
NOISE_ADAPTION = 0.1
NOISE_RANGE = (0.2, 5.0)  # of the noise that the settings give to begin with


@dataclass(frozen=True, slots=True, eq=False)
class Observation:
    """
    One set of matches as rays, shape (N, 2) each, taken at ``stamp_ns``.

    ``focal`` [px] only turns pixel thresholds into angles and back. ``edges`` are the bearings of
    the left and the right edge of the image [rad], right positive.
    """

    stamp_ns: int
    current: FloatArray
    desired: FloatArray
    focal: float
    edges: tuple[float, float] = (-HALF_PI, HALF_PI)


def observe(features: Features, camera: Camera, stamp_ns: int) -> Observation:
    """Back-project tracked features to rays, with the distortion of the camera removed."""
    return Observation(
        stamp_ns,
        frozen(camera.rays(features.current)),
        frozen(camera.rays(features.desired)),
        math.sqrt(camera.fx * camera.fy),
        camera.edges,
    )


@dataclass(frozen=True, slots=True, eq=False)
class Sight:
    """
    What one observation tells about the goal, at unit focal length.

    ``bearings`` is None where they cannot be trusted, and ``reason`` says why. ``difference`` is D
    of eq. (23), averaged over the features, ``difference_deviation`` its noise; ``feature_error``
    the median distance of current from desired features; ``parallax`` what the best rotation
    leaves unexplained; ``heading_error`` comes from the bearings where there are any, else from
    that rotation. ``deviation`` is the larger one of psi and phi, ``covariance`` that of both,
    shape (2, 2), ``jump`` the change of tilt and roll between the views [rad]; ``room`` is how far
    the robot may turn to the left and to the right before the features run out of the image [rad];
    ``memory`` is for the next frame.
    """

    stamp_ns: int
    features: int
    focal: float
    memory: Memory
    bearings: Bearings | None = None
    deviation: float = math.nan
    covariance: FloatArray = field(default_factory=lambda: UNKNOWN_COVARIANCE)
    jump: float = 0.0
    confidence: float = 0.0
    inliers: int = 0
    parallax: float = math.nan
    heading_error: float = math.nan
    difference: float = math.nan
    difference_deviation: float = math.nan
    feature_error: float = math.nan
    room: tuple[float, float] = (math.inf, math.inf)
    reason: str = ''

    @property
    def noise(self) -> float:
        """Deviation of a coordinate at unit focal length, as the residuals show it."""
        return self.memory.noise / self.focal

    @property
    def parallax_px(self) -> float:
        """Parallax in pixels."""
        return self.parallax * self.focal


def perceive(
    observation: Observation, settings: ServoSettings, frame: int, memory: Memory | None = None
) -> Sight:
    """
    Measure what the servo needs; never raises on degenerate views, says so in the Sight.

    See ``geometry``.
    """
    return geometry(observation, settings, frame, memory)[0]


def geometry(
    observation: Observation, settings: ServoSettings, frame: int, memory: Memory | None
) -> tuple[Sight, FloatArray | None]:
    """
    Return what one observation tells, and F for rays, shape (3, 3), where one was estimated.

    ``frame`` numbers the observations of a run: with the seed it fixes every random choice.
    ``memory`` is that of the last Sight, None before the first.
    """
    current, desired = observation.current, observation.desired
    count, focal = len(current), observation.focal
    blank = Sight(
        observation.stamp_ns, count, focal, fresh_memory(settings) if memory is None else memory
    )
    if count < settings.min_features:
        return replace(blank, reason=f'{count} features, {settings.min_features} needed'), None
    rotation = fit_rotation(current, desired)
    seen = replace(
        blank,
        parallax=rotation.parallax,
        heading_error=rotation.heading_error,
        feature_error=float(np.median(np.hypot(*(current - desired).T))),
        room=room_to_turn(current, observation.edges, settings.keep_features),
    )
    fundamental = None
    if seen.parallax_px < settings.min_parallax:
        reason = f'a parallax of {seen.parallax_px:.2f} px is too small for epipoles'
        seen = replace(seen, reason=reason)
    else:
        seen, fundamental = _with_bearings(seen, observation, settings, frame)
    difference = feature_difference(current, desired)
    if settings.compensates:
        # Pitch and roll of an uneven floor are those of the best rotation, the heading is better.
        heading = rotation_desired_current(seen.heading_error - rotation.heading_error)
        difference = _compensated_difference(current, desired, heading @ rotation.rotation)
    # Of |p_a|^2 - |p_d|^2 with noise in both views, on the average of N features.
    size = math.sqrt(8.0 * float((desired**2).sum()))
    deviation = size * seen.noise / count
    return replace(seen, difference=difference, difference_deviation=deviation), fundamental


def room_to_turn(
    current: FloatArray, edges: tuple[float, float], keep: int
) -> tuple[float, float]:
    """Return how far a camera may turn left and right [rad] until ``keep`` features are left."""
    bearings = np.sort(np.arctan(current[:, 0]))
    keep = min(keep, len(bearings))
    if keep == 0:
        return 0.0, 0.0
    # A left turn moves features to the right.
    left, right = edges[1] - bearings[keep - 1], bearings[-keep] - edges[0]
    return max(float(left), 0.0), max(float(right), 0.0)


def _compensated_difference(
    current: FloatArray, desired: FloatArray, rotation: FloatArray
) -> float:
    """Return D of features turned by ``rotation``, without those that stand apart."""
    level = turned(current, rotation)
    distance = np.hypot(*(level - desired).T)
    usual = distance <= APART * float(np.median(distance)) + NEGLIGIBLE
    return feature_difference(level[usual], desired[usual])


def feature_difference(current: FloatArray, desired: FloatArray) -> float:
    """Return D = mean(|p_a|^2 - |p_d|^2) over the features (eq. 23)."""
    return float(((current**2).sum(axis=1) - (desired**2).sum(axis=1)).mean())


def turned(rays: FloatArray, rotation: FloatArray) -> FloatArray:
    """
    Return ``rays``, shape (N, 2), as a camera sees them that is turned by ``rotation``, (3, 3).

    A heading error of 0.1 deg otherwise shifts the zero of D by centimetres, unless the features
    lie evenly to the left and right; a bump of 0.1 deg in the floor does so by millimetres.
    """
    solid = homogeneous(rays) @ rotation.T
    return np.asarray(solid[:, :2] / solid[:, 2:])


def _with_bearings(
    seen: Sight, observation: Observation, settings: ServoSettings, frame: int
) -> tuple[Sight, FloatArray | None]:
    current, desired, memory = observation.current, observation.desired, seen.memory
    prior = Prior(memory.attitude, memory.bearings, settings.max_leap)
    try:
        estimate = ESTIMATORS[settings.estimator](
            current,
            desired,
            noise=memory.noise / observation.focal,
            prior=prior,
            rng=np.random.default_rng((settings.seed, frame)),
        )
    except DegenerateGeometryError as error:
        return replace(seen, reason=str(error)), None
    reason = doubt(estimate, desired, memory, settings)
    noise = _noise(estimate, observation, memory.noise, settings.pixel_noise)
    room = room_to_turn(current[estimate.inliers], observation.edges, settings.keep_features)
    found = replace(
        seen,
        room=room,
        confidence=estimate.confidence,
        inliers=int(estimate.inliers.sum()),
        deviation=deviation(estimate),
        covariance=estimate.covariance,
        jump=estimate.jump,
        memory=remembered(memory, estimate, reason, noise=noise, parallax=seen.parallax_px),
        reason=reason,
    )
    if not reason:
        bearings = estimate.bearings
        found = replace(found, bearings=bearings, heading_error=bearings.heading_error)
    return found, estimate.fundamental


def _noise(estimate: Estimate, observation: Observation, before: float, first: float) -> float:
    """Return the deviation of a coordinate [px], slowly following the median residual."""
    distance = sampson_distance(estimate.fundamental, observation.current, observation.desired)
    spare = max(len(distance) - 2, 1)
    now = 1.4826 * (1.0 + 5.0 / spare) * float(np.median(np.abs(distance))) * observation.focal
    followed = before + NOISE_ADAPTION * (now - before)
    return min(max(followed, NOISE_RANGE[0] * first), NOISE_RANGE[1] * first)
