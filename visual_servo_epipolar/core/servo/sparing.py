"""Sparing: two views are not estimated where the memory of views knows better."""

from visual_servo_epipolar.core.mapping.map_measurement import MapMeasurement
from visual_servo_epipolar.core.perception.measurement import Measurement
from visual_servo_epipolar.core.perception.memory import PerceptionMemory
from visual_servo_epipolar.core.perception.perceive import perceive, Perception
from visual_servo_epipolar.core.servo.remembering import MapState
from visual_servo_epipolar.core.servo.settings import ServoSettings
from visual_servo_epipolar.core.servo.state import ServoState
from visual_servo_epipolar.core.values import changed

SPARED = 3  # views between two that are estimated all the same: noise and attitude may change


def spared_after(
    memory: PerceptionMemory,
    measurement: Measurement,
    reading: MapMeasurement | None,
    views: MapState,
) -> PerceptionMemory:
    """Return what perception carries on, after a ``measurement`` that may be by a ``reading``."""
    by_two = measurement.bearings is not None and not measurement.remembered
    if reading is None or by_two or views.views is None:
        known = memory.spared or memory.wrong is not None
        return changed(memory, spared=0, wrong=None) if known else memory
    return changed(
        memory,
        bearings=reading.bearings if measurement.remembered else memory.bearings,
        spared=memory.spared - 1 if memory.spared else SPARED,
        wrong=views.views.wrong,
    )


def learnt_after(memory: PerceptionMemory | None, views: MapState) -> PerceptionMemory | None:
    """Return what perception carries on, with wrong matches as ``views`` have learnt them."""
    if memory is None or memory.wrong is None or views.views is None:
        return memory
    wrong = views.views.wrong
    return memory if wrong == memory.wrong else changed(memory, wrong=wrong)


def is_missed(perception: Perception, measurement: Measurement, settings: ServoSettings) -> bool:
    """Return whether the estimate that was spared might tell bearings that are needed."""
    needed = not measurement.parallax <= settings.near_parallax
    return bool(perception.memory.spared) and measurement.bearings is None and needed


def looked_again(state: ServoState, perception: Perception, settings: ServoSettings) -> Perception:
    """Return a ``perception`` whose estimate was spared with one."""
    if perception.observation is None:
        return perception
    memory = changed(perception.memory, spared=0, wrong=None)
    return perceive(perception.observation, settings, state.view.frame, memory)
