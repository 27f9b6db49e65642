"""Perception of one view: observe, estimate, validate, measure."""

from dataclasses import dataclass, replace
import math
from typing import Any

import numpy as np

from visual_servo_epipolar.core.arrays import are_among, BoolArray, FloatArray, median
from visual_servo_epipolar.core.geometry.epipolar import rotation_desired_current
from visual_servo_epipolar.core.geometry.lens import change, for_wrong_rays, spurious_parallax
from visual_servo_epipolar.core.geometry.rotation import fit_rotation, RotationFit
from visual_servo_epipolar.core.perception import measures
from visual_servo_epipolar.core.perception.leaning_head import levelled
from visual_servo_epipolar.core.perception.measurement import Measurement, UNBOUNDED
from visual_servo_epipolar.core.perception.memory import fresh_memory, PerceptionMemory
from visual_servo_epipolar.core.perception.observation import Observation
from visual_servo_epipolar.core.perception.settings import PerceptionSettings
from visual_servo_epipolar.core.perception.validated import (
    noise_learnt,
    SPARED,
    validated_estimate,
    ValidatedEstimate,
)
from visual_servo_epipolar.core.values import changed


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

    Parameters
    ----------
    observation : Observation
        Matches of the current and of the desired view.
    settings : PerceptionSettings
        The estimator, and the validation gates.
    frame : int
        Number of the observation in its run: with the seed it fixes every random choice.
    memory : PerceptionMemory, optional
        What was known before, None before the first view.

    """
    memory = noise_learnt(memory or fresh_memory(settings))
    if len(observation) < settings.min_features:
        return blank(observation, settings, memory)
    observation = observation.corrected(memory.lens)
    observation = levelled(observation, memory.attitude, settings.mount)
    rotation = fit_rotation(observation.current, observation.desired)
    estimate = validated_estimate(observation, rotation, memory, settings, frame)
    better = change(estimate.memory.lens, memory.lens)
    if not better.corrects_nothing:
        observation = observation.corrected(better)
        rotation = fit_rotation(observation.current, observation.desired)
    measurement = _measurement(observation, rotation, estimate, settings)
    geometry, fundamental = estimate.estimate, None
    if geometry is not None:
        fundamental = for_wrong_rays(geometry.fundamental, memory.lens)
    return Perception(measurement, estimate.memory, fundamental, observation)


def blank(
    observation: Observation, settings: PerceptionSettings, memory: PerceptionMemory
) -> Perception:
    """Return what too few features tell two views: nothing."""
    observation = observation.corrected(memory.lens)
    observation = levelled(observation, memory.attitude, settings.mount)
    reason = f'{len(observation)} features, {settings.min_features} needed'
    measurement = Measurement(
        observation.stamp_ns, len(observation), observation.focal, memory.noise, reason=reason
    )
    return Perception(measurement, memory, observation=observation)


def of_few(
    blank: Perception, settings: PerceptionSettings, rays: FloatArray | None
) -> Measurement:
    """
    Return what too few features show all the same, to who knows where they are.

    Turn, parallax, D and margins of a ``blank`` perception of three features or more; of nothing
    the margins of ``rays``, (M, 3), at which the photograph's features would be seen. No bearings.
    """
    observation, memory = blank.observation, blank.memory
    if observation is None:
        return blank.measurement
    if rays is not None:
        every, keep = np.ones(len(rays), bool), settings.keep_features
        margins, present = _margins(rays, every, observation, keep)
        return replace(blank.measurement, view_margins=margins, present_margins=present)
    nothing = ValidatedEstimate(memory, blank.measurement.reason)
    rotation = fit_rotation(observation.current, observation.desired)
    return _measurement(observation, rotation, nothing, settings)


def _measurement(
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
    margins, present = _margins(observation.current, counted, observation, keep)
    measured: dict[str, Any] = {}
    if geometry is not None and quality is not None:
        measured = {
            'deviation': quality.deviation,
            'covariance': geometry.whole_covariance * quality.growth**2,
            'jump': geometry.jump,
            'confidence': geometry.confidence,
            'inliers': quality.inliers,
        }
    if not estimate.memory.two_view_skip:
        measured |= _differences(
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
        rotation_heading=rotation.heading_error,
        feature_error=median(measures.distances(observation.current, observation.desired)),
        view_margins=margins,
        present_margins=present,
        reason=estimate.reason,
        **measured,
    )


def _margins(
    current: FloatArray, counted: BoolArray, observation: Observation, keep: int
) -> tuple[tuple[float, float], tuple[float, float]]:
    """Return the margins of all that a head can reach, and of where it looks now."""
    edges, head = observation.edges, observation.head
    if head is None:
        return measures.view_margins(current, counted, edges, keep), UNBOUNDED
    ahead = 0.5 * (edges[0] + edges[1])
    return (
        measures.view_margins(current, counted, head.reach, keep, ahead),
        measures.view_margins(current, counted, edges, keep, ahead),
    )


def with_difference(perception: Perception, settings: PerceptionSettings) -> Measurement:
    """
    Return the measurement of a ``perception`` with D, which it may be without.

    A memory of views that knows the geometry knows D as well: where one is expected to, it is only
    computed when that has nothing to say.
    """
    measurement, observation = perception.measurement, perception.observation
    if observation is None or not perception.memory.two_view_skip:
        return measurement
    rotation = fit_rotation(observation.current, observation.desired)
    counted = usual_matches(observation, ValidatedEstimate(perception.memory, SPARED))
    differences = _differences(
        observation, rotation, measurement.heading_error, counted, perception.memory, settings
    )
    return changed(measurement, **differences)


def usual_matches(observation: Observation, estimate: ValidatedEstimate) -> BoolArray:
    """Return which matches, (N,), nobody holds for wrong."""
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


def _differences(
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
        level = measures.turned(current, better @ rotation.rotation)
        difference = measures.usual_difference(level, desired, wide, counted)
    else:
        difference = measures.feature_difference(current, desired, wide)
    noise = memory.noise / observation.focal
    deviation = measures.difference_deviation(current, desired, noise, wide)
    return {'difference': float(difference), 'difference_deviation': float(deviation)}
