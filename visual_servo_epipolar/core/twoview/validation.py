"""Validated estimates: the geometry of two views, and the gates: reasons not to act on it."""

from dataclasses import dataclass, replace
import math

import numpy as np

from visual_servo_epipolar.core.arrays import BoolArray, FloatArray, TINY
from visual_servo_epipolar.core.errors import DegenerateGeometryError
from visual_servo_epipolar.core.geometry.epipolar import (
    Bearings,
    MIN_MATCHES,
    MOTION_PARAMETERS,
    sampson_distance,
)
from visual_servo_epipolar.core.geometry.least_squares import likeliest_noise, RIGHT
from visual_servo_epipolar.core.geometry.rays import handedness
from visual_servo_epipolar.core.geometry.rotation import RotationFit
from visual_servo_epipolar.core.geometry.significance import together
from visual_servo_epipolar.core.reasons import Reason, reason_of
from visual_servo_epipolar.core.twoview.estimator import Estimate, Prior
from visual_servo_epipolar.core.twoview.general_motion import noise_of_small_baseline
from visual_servo_epipolar.core.twoview.memory import (
    MAX_REJECTIONS,
    PerceptionMemory,
    Still,
    updated_memory,
)
from visual_servo_epipolar.core.twoview.observation import Observation
from visual_servo_epipolar.core.twoview.registry import estimate
from visual_servo_epipolar.core.twoview.rolling_shutter import OF_ONE_IMAGE
from visual_servo_epipolar.core.twoview.settings import PerceptionSettings

MIN_INLIER_SHARE = 0.3
MAX_TURN_APART = 2.0  # turns that bearings, and features as a whole, may be apart [rad]
MAX_JUMP = 12.0  # of tilt and roll between the views, in deviations of the floor's jitter
# That jitter where a view shows bumps, wide enough to draw no estimate [rad]; bumps of 1 deg under
# either view, and a nod of the body, are less than 3.4 deg.
ROUGH_FLOOR, ROUGH_JUMP = 1.5e-2, 4.0
LEAST_HANDED = 0.8  # share of small triangles that turn alike, and are not mirrored
NOISE_RANGE = (0.2, 5.0)  # of the noise that the settings give to begin with


@dataclass(frozen=True, slots=True)
class FitQuality:
    """
    How well an estimate fits: number of ``inliers``, their angular ``extent`` [rad].

    ``noise`` is the deviation of a coordinate that residuals show [px]; ``growth`` is by how much
    bearings are less certain than the covariance of the estimate says, ``deviation`` the larger
    one of psi and phi with that [rad], nan if there is none. ``shared`` features count as one.
    """

    inliers: int
    extent: float
    noise: float
    growth: float
    deviation: float
    shared: float


def fit_quality(
    estimate: Estimate,
    current: FloatArray,
    desired: FloatArray,
    resolution: FloatArray,
    noise: float,
    shared: float = 1.0,
) -> FitQuality:
    """
    Return how well ``estimate`` fits unit rays, (N, 3), with angles of a pixel, (N, 2).

    It took the noise of a coordinate for ``noise`` [px]; ``shared`` matches count as one, and
    what errs together in a part of the image does not average out.
    """
    distances = sampson_distance(estimate.fundamental, current, desired, resolution)
    agree = estimate.inliers
    inliers = int(np.count_nonzero(agree))
    shown = likeliest_noise(np.abs(distances), noise)
    shared *= together(distances[None, agree], np.eye(1), desired[agree]) if inliers else 1.0
    # A few matches do not show how large their noise is: errors have Student's tails, of as many
    # degrees of freedom as there are inliers beyond a motion's parameters.
    spare = max(inliers, MIN_MATCHES) - MOTION_PARAMETERS
    growth = max(shown / noise, 1.0) * math.sqrt(spare / (spare - 2.0)) * math.sqrt(shared)
    variance = max(estimate.covariance[0, 0], estimate.covariance[1, 1], 0.0)
    extent = angular_extent(desired, estimate.inliers)
    return FitQuality(inliers, extent, shown, growth, growth * math.sqrt(variance), shared)


def angular_extent(rays: FloatArray, inliers: BoolArray) -> float:
    """
    Return how far apart the ``inliers``, (N,), among unit ``rays``, (N, 3), are.

    It is the fourth root of the determinant of their covariance across their mean direction: the
    geometric mean of the deviations along two axes [rad].
    """
    chosen = rays[inliers]
    count = max(len(chosen), 2)
    mean = chosen.sum(axis=0) / count
    across = chosen - np.outer(chosen @ mean, mean) / max(float(mean @ mean), TINY)
    _, first, other = np.linalg.eigvalsh(across.T @ across).tolist()
    return float((max(first * other, 0.0) / (count - 1.0) ** 2) ** 0.25)


def innovation(bearings: Bearings, before: Bearings) -> float:
    """Return by how much bearings changed [rad], the larger of the two."""
    psi = abs(math.remainder(bearings.psi - before.psi, 2.0 * math.pi))
    return max(psi, abs(math.remainder(bearings.phi - before.phi, 2.0 * math.pi)))


def rejection_reason(
    estimate: Estimate,
    quality: FitQuality,
    memory: PerceptionMemory,
    settings: PerceptionSettings,
    jitter: float,
) -> str:
    """
    Return why ``estimate`` does not pass the gates, in words; empty if it does.

    ``jitter`` is the deviation of tilt and roll between the views [rad].
    """
    inliers, count = quality.inliers, len(estimate.inliers)
    by_chance = min(settings.min_features, RIGHT * count)  # fewer may agree, if not most do
    if inliers < max(MIN_MATCHES, MIN_INLIER_SHARE * count, by_chance):
        return Reason.FEW_INLIERS.of(inliers, count)
    if quality.extent < settings.min_spread:
        return Reason.CLUSTERED.of(math.degrees(quality.extent))
    if estimate.confidence < settings.min_confidence:
        return Reason.UNDECIDED.of(estimate.confidence)
    deviations = ROUGH_JUMP if memory.attitude.jitter > settings.floor_jitter else MAX_JUMP
    if estimate.jump > deviations * jitter:
        return Reason.TILTED.of(math.degrees(estimate.jump))
    # That there is a direction, features show one by one; how well it is known, they do not.
    if quality.deviation > settings.max_deviation * math.sqrt(quality.shared):
        return Reason.UNCERTAIN.of(math.degrees(quality.deviation))
    return _contradiction(estimate, memory, settings)


def turned_otherwise(bearings: Bearings, heading_error: float) -> str:
    """
    Return how the turn in ``bearings`` contradicts that of a rotation alone, in words, or ''.

    Parallax makes them differ, by 1.3 rad at most in simulated runs; in a mirrored image, where a
    geometry is found by chance, they are half a turn apart.
    """
    apart = abs(math.remainder(bearings.heading_error - heading_error, 2.0 * math.pi))
    if apart > MAX_TURN_APART:
        return Reason.TURNED_OTHERWISE.of(math.degrees(apart))
    return ''


def rolled_over(rotation: FloatArray, current: FloatArray, desired: FloatArray) -> str:
    """
    Return how a best ``rotation``, (3, 3), is none of a robot on a floor, in words, or ''.

    A mirrored image looks as if the camera had rolled by half a turn, one upside down does. A turn
    about the vertical keeps y of cameras that lean by 45 deg at most within a right angle. So does
    what stands between two views that see it from opposite sides; there the features of each
    surface turn alike, and what is above stays above. Unit rays have shape (N, 3).
    """
    if rotation[1, 1] >= 0.0:
        return ''
    is_above = float(current[:, 1] @ desired[:, 1]) > 0.0
    if is_above and handedness(current, desired) > LEAST_HANDED:
        return ''
    return Reason.ROLLED_OVER.of(math.degrees(math.acos(max(float(rotation[1, 1]), -1.0))))


def _contradiction(
    estimate: Estimate, memory: PerceptionMemory, settings: PerceptionSettings
) -> str:
    """
    Return how ``estimate`` contradicts the last bearings, in words; empty if it does not.

    Without the last bearings as little is known as at the beginning: a second geometry then
    counts as it does there.
    """
    if memory.bearings is not None:
        change = innovation(estimate.bearings, memory.bearings)
        if change <= settings.max_leap:
            return ''
        if memory.consecutive_rejections + 1 < MAX_REJECTIONS:
            return Reason.LEAPT.of(math.degrees(change))
    return '' if estimate.alternative is None else Reason.TWO_GEOMETRIES.of()


@dataclass(frozen=True, slots=True, eq=False)
class ValidatedEstimate:
    """An estimate that passed the gates, or the ``reason`` why not; and the memory after it."""

    memory: PerceptionMemory
    reason: str
    estimate: Estimate | None = None
    quality: FitQuality | None = None

    @property
    def bearings(self) -> Bearings | None:
        """The bearings, if the estimate passed."""
        return None if self.reason or self.estimate is None else self.estimate.bearings

    @property
    def rivals(self) -> tuple[Bearings, ...]:
        """Both geometries, of either sign, where that alone is wrong with an estimate; or ()."""
        if self.estimate is None or self.estimate.alternative is None:
            return ()
        are_two = reason_of(self.reason) in (Reason.NONE, Reason.TWO_GEOMETRIES)
        return (self.estimate.bearings, self.estimate.alternative) if are_two else ()


def validated_estimate(
    observation: Observation,
    rotation: RotationFit,
    memory: PerceptionMemory,
    settings: PerceptionSettings,
    frame: int,
) -> ValidatedEstimate:
    """
    Estimate the geometry of one pair of views with their best rotation, and validate.

    A floor is even until a view tilts more than such a floor does: from then on it is rough.
    """
    parallax_px = rotation.parallax * observation.focal
    # Below eight deviations of the noise a search finds a baseline in noise alone.
    if parallax_px < settings.min_parallax * memory.noise / settings.pixel_noise:
        if settings.calibrated:  # through an unknown lens a turn alone leaves more than noise
            still = Still(observation, rotation.rotation, settings.pixel_noise)
            memory = replace(memory, unlearnt=still)
        return ValidatedEstimate(memory, Reason.SMALL_PARALLAX.of(parallax_px))
    if memory.two_view_skip:
        return ValidatedEstimate(memory, Reason.SKIPPED.of())
    prior = prior_of(memory, settings, observation)
    try:
        geometry = estimate(
            settings.estimator,
            observation.current,
            observation.desired,
            noise=memory.noise * observation.resolution,
            prior=prior,
            seed=(settings.seed, frame),
        )
    except DegenerateGeometryError as error:
        return ValidatedEstimate(memory, str(error))
    rays = observation.current, observation.desired, observation.resolution
    quality = fit_quality(geometry, *rays, memory.noise, observation.shared)
    reason = rejection_reason(geometry, quality, memory, settings, prior.attitude.jitter)
    if reason_of(reason) is Reason.TILTED and memory.attitude.jitter < ROUGH_FLOOR:
        rough = replace(memory, attitude=replace(settings.mount, jitter=ROUGH_FLOOR))
        return validated_estimate(observation, rotation, rough, settings, frame)
    if settings.calibrated:  # through an unknown lens a turn looks another
        reason = reason or turned_otherwise(geometry.bearings, rotation.heading_error)
    reason = reason or rolled_over(rotation.rotation, observation.current, observation.desired)
    noise = _noise(quality.noise, memory.noise, settings.pixel_noise)
    memory = updated_memory(memory, geometry, reason, noise=noise, parallax=parallax_px)
    return ValidatedEstimate(memory, reason, geometry, quality)


def noise_learnt(memory: PerceptionMemory) -> PerceptionMemory:
    """
    Return the ``memory`` with the noise that the last view showed, had it no baseline.

    It follows slowly: one view later is soon enough, and no twist waits for it.
    """
    still = memory.unlearnt
    if still is None:
        return memory
    seen = still.observation
    views = seen.current, seen.desired, seen.resolution
    now = noise_of_small_baseline(*views, still.rotation, memory.noise)
    return replace(memory, noise=_noise(now, memory.noise, still.first_noise), unlearnt=None)


def prior_of(
    memory: PerceptionMemory, settings: PerceptionSettings, observation: Observation
) -> Prior:
    """Return what an estimator may know beforehand of an ``observation``."""
    attitude = replace(memory.attitude, jitter=observation.jitter(memory.attitude))
    mount = memory.mount_by(settings)
    return Prior(attitude, memory.bearings, settings.max_leap, memory.lens, mount, memory.decided)


def _noise(now: float, before: float, first: float) -> float:
    """Return the deviation of a coordinate [px], slowly following what it is ``now``."""
    followed = before + OF_ONE_IMAGE * (now - before)
    return min(max(followed, NOISE_RANGE[0] * first), NOISE_RANGE[1] * first)
