"""Fuse: two views and the map become one measurement, or the surer map alone."""

from dataclasses import replace
import math
from typing import NamedTuple

from visual_servo_epipolar.core.estimate.map_state import localize, MapState, measurement_of
from visual_servo_epipolar.core.estimators.base import UNKNOWN_COVARIANCE
from visual_servo_epipolar.core.mapping.localization import MapMeasurement
from visual_servo_epipolar.core.odometry.increments import OdometryIncrement
from visual_servo_epipolar.core.perception.measurement import Measurement
from visual_servo_epipolar.core.perception.memory import fresh_memory, PerceptionMemory
from visual_servo_epipolar.core.perception.observation import Observation
from visual_servo_epipolar.core.perception.perceive import perceive, Perception, with_difference
from visual_servo_epipolar.core.perception.rivals import (
    ahead_of_both,
    begun,
    followed,
    in_order,
)
from visual_servo_epipolar.core.reasons import Reason
from visual_servo_epipolar.core.servo.settings import ServoSettings
from visual_servo_epipolar.core.servo.state import ServoState

SKIPPED = 3  # views between two that are estimated all the same: noise and attitude may change


class Fusion(NamedTuple):
    """
    What two views and the map make of an image together.

    ``reading`` is what the ``map`` measures, None if nothing; ``memory`` what perception carries
    on, ``rotation_bias`` what the best rotation is off in heading [rad], nan while unknown.
    """

    measurement: Measurement
    memory: PerceptionMemory
    map: MapState
    reading: MapMeasurement | None = None
    rotation_bias: float = math.nan


def fuse(
    state: ServoState,
    perception: Perception,
    increment: OdometryIncrement,
    dt: float,
    settings: ServoSettings,
) -> Fusion:
    """Return what two views, by ``perception``, and the map know ``dt`` [s] after the last."""
    seconds = dt if state.phase.runs else 0.0
    after, reading = localize(
        state.map,
        perception,
        increment,
        settings,
        dt=seconds,
        encoder_noise=state.check.head.noise,
    )
    measurement = measurement_of(perception, reading, after, settings)
    memory, seen = perception.memory, perception.observation
    needed = measurement.bearings is None and not measurement.parallax <= settings.near_parallax
    if needed and memory.two_view_skip and seen is not None:  # the estimate that was skipped
        memory = replace(memory, two_view_skip=0, wrong=None)
        perception = perceive(seen, settings, state.view.frame, memory)
        measurement = measurement_of(perception, reading, after, settings)
    memory = two_view_skip(perception.memory, measurement, reading, after)
    memory = _with_rivals(memory, measurement, seen, state, increment.motion.way, settings)
    return Fusion(measurement, memory, after, reading)


def _with_rivals(
    memory: PerceptionMemory,
    measurement: Measurement,
    seen: Observation | None,
    state: ServoState,
    way: float,
    settings: ServoSettings,
) -> PerceptionMemory:
    """Return what perception carries on of two geometries that fit: one, once the way tells."""
    before = memory.rivals
    if not measurement.rivals or seen is None or not state.phase.drives:
        return memory if before is None else replace(memory, rivals=None)
    if before is None:
        before = begun(measurement.rivals, measurement.rotation_heading)
    ordered = in_order(measurement.rivals, before)
    extrinsics = state.identified.extrinsics or settings.extrinsics
    rivals = followed(before, ordered, seen, way, extrinsics.mount)
    if rivals.decided is None:
        return replace(memory, rivals=rivals)
    bearings = ahead_of_both(ordered[rivals.decided], seen)
    return replace(memory, rivals=None, decided=True, bearings=bearings, consecutive_rejections=0)


def disproved(perception: Perception, settings: ServoSettings) -> Fusion:
    """Return a fusion without a geometry that driving disproves, and what led to it."""
    measurement = replace(
        with_difference(perception, settings),
        bearings=None,
        deviation=math.nan,
        covariance=UNKNOWN_COVARIANCE,
        confidence=0.0,
        difference=math.nan,
        reason=Reason.DISPROVED.of(),
    )
    memory = replace(fresh_memory(settings), shutter=perception.memory.shutter)
    return Fusion(measurement, memory, MapState())


def two_view_skip(
    memory: PerceptionMemory,
    measurement: Measurement,
    reading: MapMeasurement | None,
    after: MapState,
) -> PerceptionMemory:
    """Return what perception carries on, after a ``measurement`` that may be by a ``reading``."""
    by_two = measurement.bearings is not None and not measurement.remembered
    if reading is None or by_two or after.views is None:
        known = memory.two_view_skip or memory.wrong is not None
        return replace(memory, two_view_skip=0, wrong=None) if known else memory
    return replace(
        memory,
        bearings=reading.bearings if measurement.remembered else memory.bearings,
        two_view_skip=memory.two_view_skip - 1 if memory.two_view_skip else SKIPPED,
        wrong=after.views.wrong,
    )


def with_wrong_matches(
    memory: PerceptionMemory | None, after: MapState
) -> PerceptionMemory | None:
    """Return what perception carries on, with wrong matches as the map has them ``after``."""
    if memory is None or memory.wrong is None or after.views is None:
        return memory
    wrong = after.views.wrong
    return memory if wrong == memory.wrong else replace(memory, wrong=wrong)
