"""Perception of one view: observe, estimate, validate, measure."""

from dataclasses import dataclass, replace

from visual_servo_epipolar.core.arrays import FloatArray
from visual_servo_epipolar.core.geometry.lens import change, for_wrong_rays
from visual_servo_epipolar.core.geometry.rotation import fit_rotation
from visual_servo_epipolar.core.reasons import Reason
from visual_servo_epipolar.core.twoview.measurement import (
    measure_difference,
    measured,
    Measurement,
    usual_matches,
)
from visual_servo_epipolar.core.twoview.memory import fresh_memory, PerceptionMemory
from visual_servo_epipolar.core.twoview.observation import Observation
from visual_servo_epipolar.core.twoview.rolling_shutter import base_axes
from visual_servo_epipolar.core.twoview.settings import PerceptionSettings
from visual_servo_epipolar.core.twoview.validation import (
    noise_learnt,
    validated_estimate,
    ValidatedEstimate,
)


@dataclass(frozen=True, slots=True, eq=False)
class Perception:
    """
    A measurement, the memory for the next view, and F for rays, (3, 3), if estimated.

    ``observation`` is what was looked at, corrected as the lens is known.
    """

    measurement: Measurement
    memory: PerceptionMemory
    fundamental: FloatArray | None = None
    observation: Observation | None = None


def perceive(
    observation: Observation,
    settings: PerceptionSettings,
    frame: int,
    memory: PerceptionMemory | None = None,
) -> Perception:
    """
    Measure what the servo needs; never raises on degenerate views, the measurement says so.

    ``frame``, the number of the observation in its run, fixes every random choice together with
    the seed; ``memory`` is what was known before, None before the first view.
    """
    memory = noise_learnt(memory or fresh_memory(settings))
    if observation.rows is not None and settings.calibrated:  # a wrong lens shears as well
        attitude = memory.attitude
        axes = base_axes(attitude.tilt, attitude.roll, settings.mount_yaw)
        shutter = memory.shutter.updated(observation, axes, settings.readout)
        memory = replace(memory, shutter=shutter)
        observation = observation.at_one_instant(shutter.turn(settings.readout))
    observation = observation.corrected(memory.lens).levelled(memory.attitude, settings.mount)
    count = len(observation)
    if count < settings.min_features:  # too few tell two views nothing
        reason = Reason.FEW_FEATURES.of(count, settings.min_features)
        measurement = Measurement(
            observation.stamp_ns, count, observation.focal, memory.noise, reason=reason
        )
        return Perception(measurement, memory, observation=observation)
    rotation = fit_rotation(observation.current, observation.desired)
    estimate = validated_estimate(observation, rotation, memory, settings, frame)
    better = change(estimate.memory.lens, memory.lens)
    if not better.corrects_nothing:
        observation = observation.corrected(better)
        rotation = fit_rotation(observation.current, observation.desired)
    measurement = measured(observation, rotation, estimate, settings)
    geometry, fundamental = estimate.estimate, None
    if geometry is not None:
        fundamental = for_wrong_rays(geometry.fundamental, memory.lens)
    return Perception(measurement, estimate.memory, fundamental, observation)


def of_few(blank: Perception, settings: PerceptionSettings) -> Measurement:
    """
    Return what too few features for two views show all the same, to a map of the features.

    Turn, parallax, D and margins of a ``blank`` perception of three features or more, no bearings.
    """
    observation, memory = blank.observation, blank.memory
    if observation is None:
        return blank.measurement
    nothing = ValidatedEstimate(memory, blank.measurement.reason)
    rotation = fit_rotation(observation.current, observation.desired)
    return measured(observation, rotation, nothing, settings)


def with_difference(perception: Perception, settings: PerceptionSettings) -> Measurement:
    """
    Return the measurement of a ``perception`` with D, which it may be without.

    A memory of views that has the geometry has D as well: where one is expected to, it is only
    computed when that has nothing to say.
    """
    measurement, observation = perception.measurement, perception.observation
    if observation is None or not perception.memory.two_view_skip:
        return measurement
    rotation = fit_rotation(observation.current, observation.desired)
    skipped = ValidatedEstimate(perception.memory, Reason.SKIPPED.of())
    counted, memory = usual_matches(observation, skipped), perception.memory
    return measure_difference(measurement, observation, rotation, counted, memory, settings)
