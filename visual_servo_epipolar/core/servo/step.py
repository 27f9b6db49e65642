"""
One control step: ``step(state, observation, settings)``.

The live node, the replay of a bag and the simulation in memory all call it. What was seen becomes
an event (``events.classify``), the event a phase (``phases.next_phase``), the phase a law
(``steering.command``).
"""

from dataclasses import replace
import math

from visual_servo_epipolar.core.geometry.motion import (
    beyond_dead_band,
    pulsed,
    ramped,
    saturate,
    STANDSTILL,
    Twist,
)
from visual_servo_epipolar.core.perception.perceive import Measurement, Observation, perceive
from visual_servo_epipolar.core.servo.derived_gains import gains_here, legal_target
from visual_servo_epipolar.core.servo.phases.commands import command, straightened
from visual_servo_epipolar.core.servo.phases.conditions import displacement
from visual_servo_epipolar.core.servo.phases.events import classify
from visual_servo_epipolar.core.servo.phases.table import DRIVING, Event, next_phase, Phase
from visual_servo_epipolar.core.servo.ranging import Leg
from visual_servo_epipolar.core.servo.settings import ServoSettings
from visual_servo_epipolar.core.servo.state import ServoState
from visual_servo_epipolar.core.servo.update import interval, remember
from visual_servo_epipolar.core.stamps import seconds_between

USUAL_STEP_S = 0.1  # to accelerate over, when no image came before


def step(state: ServoState, observation: Observation, settings: ServoSettings) -> ServoState:
    """Return the state after ``observation``; its ``twist`` is what the robot shall do."""
    memory = None if state.measurement is None else state.measurement.memory
    return advance(state, perceive(observation, settings, state.frame, memory), settings)


def advance(state: ServoState, measurement: Measurement, settings: ServoSettings) -> ServoState:
    """Return the state after ``measurement``: the part of the step that needs no features."""
    before, last = state.measurement, state.twist
    dt = 0.0 if before is None else interval(before.stamp_ns, measurement.stamp_ns)
    state = remember(state, measurement, settings)
    event = classify(state, settings)
    if before is not None and measurement.stamp_ns <= before.stamp_ns:
        state, event = _out_of_time(state, measurement)
    state = _switch(state, state.measurement or measurement, event, settings)
    wanted = straightened(command(state, settings), state, settings)
    wanted = _within_limits(wanted, last, dt or USUAL_STEP_S, state, settings)
    twist, dead_band_residual = _beyond_dead_band(wanted, state, settings)
    return replace(
        state, twist=twist, dead_band_residual=dead_band_residual, frame=state.frame + 1
    )


def _out_of_time(state: ServoState, measurement: Measurement) -> tuple[ServoState, Event]:
    """Hold when the stamps stand still or run backwards: images that nobody should act on."""
    if state.phase not in DRIVING:
        return replace(state, phase_start_ns=measurement.stamp_ns), Event.NOTHING
    measurement = replace(measurement, reason='the stamps of the images do not advance')
    return replace(state, measurement=measurement, phase_start_ns=measurement.stamp_ns), Event.LOST


def lost(state: ServoState, reason: str) -> ServoState:
    """Return the state of a servo that hears nothing any more: holding, at a standstill."""
    phase = next_phase(state.phase, Event.LOST)
    if phase is state.phase:
        return replace(state, twist=STANDSTILL)
    return replace(state, phase=phase, twist=STANDSTILL, settled=0, reason=reason)


def _within_limits(
    wanted: Twist, last: Twist, dt: float, state: ServoState, settings: ServoSettings
) -> Twist:
    """Return what limits and accelerations leave of ``wanted``."""
    twist = saturate(wanted, max_linear=settings.max_linear, max_angular=settings.max_angular)
    if settings.law != 'full' or state.phase not in DRIVING:
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
    """Return what the motors can follow of ``wanted``, and what they owe then."""
    bounds = {'linear': settings.dead_band_linear, 'angular': settings.dead_band_angular}
    # Where nothing is left to do, a small command made larger would only undo it.
    mode = 'zero' if state.settled else settings.dead_band_mode
    if mode == 'pulse':
        return pulsed(wanted, state.dead_band_residual, **bounds)
    return beyond_dead_band(wanted, mode=mode, **bounds), STANDSTILL


def stop(state: ServoState) -> ServoState:
    """Return the state of a servo that was told to stop: waiting, at a standstill."""
    return ServoState(phase=next_phase(state.phase, Event.STOPPED), frame=state.frame)


def _switch(
    state: ServoState, measurement: Measurement, event: Event, settings: ServoSettings
) -> ServoState:
    """Follow the transition table, and prepare what the new phase needs."""
    phase = next_phase(state.phase, event)
    if phase is state.phase:
        return state
    state = replace(
        state,
        phase=phase,
        phase_start_ns=measurement.stamp_ns,
        run_start_ns=measurement.stamp_ns if state.phase is Phase.WAITING else state.run_start_ns,
        settled=0,
        reason=_reason(state, measurement, event, settings),
        attempts=state.attempts + (event is Event.MISSED),
    )
    if phase in (Phase.DISPLACING, Phase.ZEROING_EPIPOLES) and measurement.bearings is not None:
        bearing = measurement.bearings.chi
        side = math.copysign(1.0, bearing)
        leg = Leg(measurement.bearings.psi)
        state = replace(state, side=side, latched=False, leg=leg)
    try:
        return _prepared(state, measurement, settings)
    except ValueError as error:
        refused = _switch(state, measurement, Event.NO_GAIN, settings)
        return replace(refused, reason=str(error))


def _prepared(state: ServoState, measurement: Measurement, settings: ServoSettings) -> ServoState:
    """Return ``state`` with the target or the gains of its phase; raises if none are legal."""
    if state.phase is Phase.DISPLACING:
        target = legal_target(state, measurement, settings) if settings.derives else None
        return replace(state, target=_target(measurement, settings) if target is None else target)
    if settings.derives and state.phase in (Phase.ZEROING_EPIPOLES, Phase.MATCHING_FEATURES):
        return replace(state, gains=gains_here(state, measurement, settings))
    return state


def _target(measurement: Measurement, settings: ServoSettings) -> float:
    """Return where DISPLACING puts the current epipole (section IV-B, remarks; or discordant)."""
    bearings = measurement.bearings
    if bearings is None:
        return 0.0
    if settings.law == 'full':
        return math.tan(displacement(measurement, settings) or 0.0)
    return math.copysign(math.tan(2.0 * settings.singular_epipole), bearings.epipole_current)


def _reason(
    state: ServoState, measurement: Measurement, event: Event, settings: ServoSettings
) -> str:
    """Say why a phase was left, for the log and for the verdict on the run."""
    name = state.phase.value
    run = seconds_between(state.run_start_ns, measurement.stamp_ns)
    if event is Event.TIMED_OUT and run > settings.run_timeout:
        return f'the run took longer than {settings.run_timeout:g} s, still {name}'
    if event is Event.TIMED_OUT and state.phase is Phase.HOLDING:
        return f'tracks lost or untrusted for {settings.holding_timeout:g} s: {state.reason}'
    if event is Event.TIMED_OUT:
        return f'{name} took longer than {settings.phase_timeout:g} s'
    if event is Event.DIVERGED:
        return f'the desired epipole ran away to infinity in {name}'
    if event in (Event.MISSED, Event.EXHAUSTED):
        error = measurement.feature_error * measurement.focal
        return (
            f'features are {error:.1f} px off, parallax {measurement.parallax_px:.1f} px, '
            f'at the end of attempt {state.attempts}'
        )
    if event is Event.LOST:
        return measurement.reason or f'bearings not trusted in {name}'
    return str(event.value)
