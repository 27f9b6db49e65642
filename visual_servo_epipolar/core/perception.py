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

    ``focal`` [px] only turns pixel thresholds into angles and back.
    """

    stamp_ns: int
    current: FloatArray
    desired: FloatArray
    focal: float


def observe(features: Features, camera: Camera, stamp_ns: int) -> Observation:
    """Back-project tracked features to rays, with the distortion of the camera removed."""
    return Observation(
        stamp_ns,
        frozen(camera.rays(features.current)),
        frozen(camera.rays(features.desired)),
        math.sqrt(camera.fx * camera.fy),
    )


@dataclass(frozen=True, slots=True, eq=False)
class Sight:
    """
    What one observation tells about the goal, at unit focal length.

    ``bearings`` is None where they cannot be trusted, and ``reason`` says why. ``difference`` is D
    of eq. (23), averaged over the features; ``feature_error`` the median distance of current from
    desired features; ``parallax`` what the best rotation leaves unexplained; ``heading_error``
    comes from the bearings where there are any, else from that rotation. ``deviation`` is the
    larger one of psi and phi, ``covariance`` that of both, shape (2, 2), ``jump`` the change of
    tilt and roll between the views [rad]; ``memory`` is for the next frame.
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
    feature_error: float = math.nan
    reason: str = ''

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
    )
    fundamental = None
    if seen.parallax_px < settings.min_parallax:
        reason = f'a parallax of {seen.parallax_px:.2f} px is too small for epipoles'
        seen = replace(seen, reason=reason)
    else:
        seen, fundamental = _with_bearings(seen, observation, settings, frame)
    difference = feature_difference(current, desired)
    if settings.compensates:
        difference = _compensated_difference(current, desired, seen.heading_error)
    return replace(seen, difference=difference), fundamental


def _compensated_difference(
    current: FloatArray, desired: FloatArray, heading_error: float
) -> float:
    """Return D of features turned to the desired heading, without those that stand apart."""
    level = turned(current, heading_error)
    distance = np.hypot(*(level - desired).T)
    usual = distance <= APART * float(np.median(distance)) + NEGLIGIBLE
    return feature_difference(level[usual], desired[usual])


def feature_difference(current: FloatArray, desired: FloatArray) -> float:
    """Return D = mean(|p_a|^2 - |p_d|^2) over the features (eq. 23)."""
    return float(((current**2).sum(axis=1) - (desired**2).sum(axis=1)).mean())


def turned(rays: FloatArray, heading_error: float) -> FloatArray:
    """
    Return ``rays``, shape (N, 2), as a camera with the desired heading would see them.

    A heading error of 0.1 deg otherwise shifts the zero of D by centimetres, unless the features
    lie evenly to the left and right.
    """
    solid = homogeneous(rays) @ rotation_desired_current(heading_error).T
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
    found = replace(
        seen,
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
