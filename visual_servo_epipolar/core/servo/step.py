"""
One control step: from a set of tracks to a command.

The live node, the replay of a bag and the simulation in memory all call ``step``. In the order in
which a reader meets them: an observation is perceived (estimated, validated, measured:
``perception.perceive``), the state takes the measurement in (``update``), the situation becomes an
event (``phases.events``), the event a phase (``phases.table``), the phase a velocity
(``phases.commands``), and the base gets what its limits leave of it.
"""

from dataclasses import replace

from visual_servo_epipolar.core.control.command import Command
from visual_servo_epipolar.core.geometry.motion import (
    beyond_dead_band,
    pulsed,
    ramped,
    saturate,
    STANDSTILL,
    Twist,
)
from visual_servo_epipolar.core.perception.measurement import Measurement
from visual_servo_epipolar.core.perception.observation import Observation
from visual_servo_epipolar.core.perception.perceive import perceive, Perception
from visual_servo_epipolar.core.servo.phases.commands import straightened, wanted_twist
from visual_servo_epipolar.core.servo.phases.events import classify
from visual_servo_epipolar.core.servo.phases.switch import switched
from visual_servo_epipolar.core.servo.phases.table import DRIVING, Event
from visual_servo_epipolar.core.servo.settings import ServoSettings
from visual_servo_epipolar.core.servo.state import ServoState
from visual_servo_epipolar.core.servo.update import interval, updated

USUAL_STEP_S = 0.1  # to accelerate over, when no image came before


def step(state: ServoState, observation: Observation, settings: ServoSettings) -> ServoState:
    """Return the state after ``observation``; its ``command`` is what the robot shall do."""
    perception = perceive(observation, settings, state.frame, state.memory)
    return advance(state, perception, settings)


def advance(state: ServoState, perception: Perception, settings: ServoSettings) -> ServoState:
    """Return the state after a ``perception``: the part of the step that needs no features."""
    before, last, measurement = state.measurement, state.twist, perception.measurement
    dt = 0.0 if before is None else interval(before.stamp_ns, measurement.stamp_ns)
    state = updated(replace(state, memory=perception.memory), measurement, settings)
    event = classify(state, settings)
    if before is not None and measurement.stamp_ns <= before.stamp_ns:
        state, event = _out_of_time(state, measurement)
    state = switched(state, state.measurement or measurement, event, settings)
    wanted = straightened(wanted_twist(state, settings), state, settings)
    wanted = _within_limits(wanted, last, dt or USUAL_STEP_S, state, settings)
    twist, residual = _beyond_dead_band(wanted, state, settings)
    return replace(
        state, command=Command(twist), dead_band_residual=residual, frame=state.frame + 1
    )


def _out_of_time(state: ServoState, measurement: Measurement) -> tuple[ServoState, Event]:
    """Hold when the stamps stand still or run backwards: images that nobody should act on."""
    if state.phase not in DRIVING:
        return replace(state, phase_start_ns=measurement.stamp_ns), Event.NOTHING
    measurement = replace(measurement, reason='the stamps of the images do not advance')
    state = replace(state, measurement=measurement, phase_start_ns=measurement.stamp_ns)
    return state, Event.LOST


def _within_limits(
    wanted: Twist, last: Twist, dt: float, state: ServoState, settings: ServoSettings
) -> Twist:
    """Return what limits and accelerations leave of ``wanted``."""
    twist = saturate(wanted, max_linear=settings.max_linear, max_angular=settings.max_angular)
    if not settings.options.speed_ramps or state.phase not in DRIVING:
        return twist
    return ramped(
        twist,
        last,
        dt,
        linear=settings.max_acceleration,
        angular=settings.max_angular_acceleration,
    )


def _beyond_dead_band(
    wanted: Twist, state: ServoState, settings: ServoSettings
) -> tuple[Twist, Twist]:
    """Return what the motors can follow of ``wanted``, and what is kept back for later."""
    thresholds = {'linear': settings.dead_band_linear, 'angular': settings.dead_band_angular}
    # Where nothing is left to do, a small command made larger would only undo it.
    mode = 'zero' if state.settled else settings.dead_band_mode
    if mode == 'pulse':
        return pulsed(wanted, state.dead_band_residual, **thresholds)
    return beyond_dead_band(wanted, mode=mode, **thresholds), STANDSTILL
