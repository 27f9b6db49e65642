"""Validated estimates: the geometry of one pair of views, or why there is none to act on."""

from dataclasses import dataclass, replace

from visual_servo_epipolar.core.arrays import FloatArray
from visual_servo_epipolar.core.errors import DegenerateGeometryError
from visual_servo_epipolar.core.estimators.base import Estimate, Prior
from visual_servo_epipolar.core.estimators.registry import estimate
from visual_servo_epipolar.core.geometry.epipolar import Bearings
from visual_servo_epipolar.core.geometry.least_squares import deviation_of
from visual_servo_epipolar.core.geometry.rotation import RotationFit
from visual_servo_epipolar.core.geometry.small_baseline import fundamental_of_small_baseline
from visual_servo_epipolar.core.perception.leaning_head import with_jitter
from visual_servo_epipolar.core.perception.memory import (
    PerceptionMemory,
    Still,
    updated_memory,
)
from visual_servo_epipolar.core.perception.observation import Observation
from visual_servo_epipolar.core.perception.settings import PerceptionSettings
from visual_servo_epipolar.core.perception.validation import (
    fit_quality,
    FitQuality,
    is_one,
    median_residual,
    rejection_reason,
    rolled_over,
    ROUGH_FLOOR,
    turned_otherwise,
)
from visual_servo_epipolar.core.reasons import Reason, reason_of

NOISE_ADAPTION = 0.1
NOISE_RANGE = (0.2, 5.0)  # of the noise that the settings give to begin with


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
        reason = reason_of(self.reason)
        are_two = reason is Reason.TWO_GEOMETRIES or not (self.reason or is_one(self.estimate))
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
    reason = no_baseline(parallax_px, memory.noise, settings)
    if reason:
        return without_baseline(observation, rotation.rotation, memory, settings, reason)
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


def no_baseline(parallax_px: float, noise: float, settings: PerceptionSettings) -> str:
    """
    Return why a parallax [px] shows no epipoles, in words; empty if it does.

    Below eight deviations of the ``noise`` [px], as the defaults have it, covariances mean
    nothing: a search finds a baseline in noise alone. Above, they decide.
    """
    if parallax_px < settings.min_parallax * noise / settings.pixel_noise:
        return Reason.SMALL_PARALLAX.of(parallax_px)
    return ''


def without_baseline(
    observation: Observation,
    rotation: FloatArray,
    memory: PerceptionMemory,
    settings: PerceptionSettings,
    reason: str,
) -> ValidatedEstimate:
    """
    Return no estimate, for a ``reason``, and a memory that has the noise yet to learn.

    What counts as arrived is measured in noise: a guess of it, or one that a wrong lens made
    larger far away, would let the robot stop too early.
    """
    if settings.calibrated:  # through an unknown lens a turn alone leaves more than noise
        still = Still(observation, rotation, settings.pixel_noise)
        memory = replace(memory, unlearnt=still)
    return ValidatedEstimate(memory, reason)


def noise_learnt(memory: PerceptionMemory) -> PerceptionMemory:
    """
    Return the ``memory`` with the noise that the last view showed, had it no baseline.

    It follows slowly: one view later is soon enough, and no twist waits for it.
    """
    still = memory.unlearnt
    if still is None:
        return memory
    seen = still.observation
    fundamental = fundamental_of_small_baseline(still.rotation, seen.current, seen.desired)
    residual = median_residual(fundamental, seen.current, seen.desired, seen.resolution)
    now = deviation_of(float(residual), len(seen) - 2)
    return replace(memory, noise=_noise(now, memory.noise, still.first_noise), unlearnt=None)


def prior_of(
    memory: PerceptionMemory, settings: PerceptionSettings, observation: Observation
) -> Prior:
    """Return what an estimator may know beforehand of an ``observation``."""
    attitude = with_jitter(memory.attitude, observation)
    mount = memory.mount_by(settings)
    return Prior(attitude, memory.bearings, settings.max_leap, memory.lens, mount, memory.decided)


def _noise(now: float, before: float, first: float) -> float:
    """Return the deviation of a coordinate [px], slowly following what it is ``now``."""
    followed = before + NOISE_ADAPTION * (now - before)
    return min(max(followed, NOISE_RANGE[0] * first), NOISE_RANGE[1] * first)
