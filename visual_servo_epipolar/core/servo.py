"""
One control step: ``step(state, observation, settings)``.

The live node, the replay of a bag and the simulation in memory all call it. What was seen becomes
an event (``events.classify``), the event a phase (``phases.next_phase``), the phase a law.
"""

from dataclasses import replace
import math

from visual_servo_epipolar.core import laws
from visual_servo_epipolar.core.epipolar import Bearings
from visual_servo_epipolar.core.events import (
    bearing_current,
    bearing_desired,
    classify,
    displacement,
)
from visual_servo_epipolar.core.motion import beyond_dead_band, ramped, saturate, STANDSTILL, Twist
from visual_servo_epipolar.core.perception import Observation, perceive, Sight
from visual_servo_epipolar.core.phases import DRIVING, Event, next_phase, Phase
from visual_servo_epipolar.core.ranging import Leg
from visual_servo_epipolar.core.recollection import interval, lateral_offset, remember
from visual_servo_epipolar.core.servo_settings import ServoSettings
from visual_servo_epipolar.core.servo_state import ServoState
from visual_servo_epipolar.core.stamps import seconds_between

USUAL_STEP_S = 0.1  # to accelerate over, when no image came before
CREEP = 0.02  # braking never asks for less, lest noise in the rate stop the robot [m/s]


def step(state: ServoState, observation: Observation, settings: ServoSettings) -> ServoState:
    """Return the state after ``observation``; its ``twist`` is what the robot shall do."""
    memory = None if state.sight is None else state.sight.memory
    return advance(state, perceive(observation, settings, state.frame, memory), settings)


def advance(state: ServoState, sight: Sight, settings: ServoSettings) -> ServoState:
    """Return the state after ``sight``: the part of the step that needs no features."""
    before, last = state.sight, state.twist
    dt = 0.0 if before is None else interval(before.stamp_ns, sight.stamp_ns)
    state = remember(state, sight, settings)
    event = classify(state, settings)
    if before is not None and sight.stamp_ns <= before.stamp_ns:
        state, event = _out_of_time(state, sight)
    state = _switch(state, state.sight or sight, event, settings)
    twist = _feasible(command(state, settings), last, dt or USUAL_STEP_S, state, settings)
    return replace(state, twist=twist, frame=state.frame + 1)


def _out_of_time(state: ServoState, sight: Sight) -> tuple[ServoState, Event]:
    """Hold when the stamps stand still or run backwards: images that nobody should act on."""
    if state.phase not in DRIVING:
        return replace(state, phase_start_ns=sight.stamp_ns), Event.NOTHING
    sight = replace(sight, reason='the stamps of the images do not advance')
    return replace(state, sight=sight, phase_start_ns=sight.stamp_ns), Event.LOST


def lost(state: ServoState, reason: str) -> ServoState:
    """Return the state of a servo that hears nothing any more: holding, at a standstill."""
    phase = next_phase(state.phase, Event.LOST)
    if phase is state.phase:
        return replace(state, twist=STANDSTILL)
    return replace(state, phase=phase, twist=STANDSTILL, settled=0, reason=reason)


def _feasible(
    wanted: Twist, last: Twist, dt: float, state: ServoState, settings: ServoSettings
) -> Twist:
    """Return what the base can do of ``wanted``: limits, accelerations, dead band."""
    twist = saturate(wanted, max_linear=settings.max_linear, max_angular=settings.max_angular)
    if settings.law == 'full' and state.phase in DRIVING:
        twist = ramped(
            twist,
            last,
            dt,
            linear=settings.max_acceleration,
            angular=settings.max_angular_acceleration,
        )
    return beyond_dead_band(
        twist,
        linear=settings.dead_band_linear,
        angular=settings.dead_band_angular,
        # Where nothing is left to do, lifting a small command would only undo it.
        mode='zero' if state.settled else settings.dead_band_mode,
    )


def stop(state: ServoState) -> ServoState:
    """Return the state of a servo that was told to stop: waiting, at a standstill."""
    return ServoState(phase=next_phase(state.phase, Event.STOPPED), frame=state.frame)


def command(state: ServoState, settings: ServoSettings) -> Twist:
    """Return the law of the phase, before saturation."""
    sight = state.sight
    if sight is None:
        return STANDSTILL
    if state.phase is Phase.ORIENTING:
        return laws.turn_to_heading(sight.heading_error, gain=settings.turn_gain)
    if state.phase is Phase.RETREATING:
        return _retreat(sight, settings)
    if state.phase is Phase.MATCHING_FEATURES:
        return _second_step(state, sight, settings)
    if sight.bearings is None:
        return STANDSTILL
    if state.phase is Phase.DISPLACING:
        return laws.turn_epipole(
            sight.bearings.epipole_current, state.target, k1=settings.turn_gain
        )
    if state.phase is Phase.ZEROING_EPIPOLES:
        return _first_step(state, sight, settings)
    return STANDSTILL


def _retreat(sight: Sight, settings: ServoSettings) -> Twist:
    """Turn to the goal's heading as far as the view allows, then back off."""
    left, right = sight.room
    left_to_turn = -sight.heading_error
    allowed = min(max(left_to_turn, -right), left)
    turning = abs(allowed) > settings.retreat_heading
    turn = laws.turn_to_heading(-allowed, gain=settings.turn_gain)
    return replace(turn, linear=0.0 if turning else -settings.retreat_speed)


def _held_epipole(state: ServoState, sight: Sight) -> float:
    """Return where to hold e_au: at the target, but never so that features leave the view."""
    if sight.bearings is None:
        return state.target
    here, (left, right) = bearing_current(sight.bearings), sight.room
    wanted = math.atan(state.target)
    return math.tan(min(max(wanted, here - right), here + left))


def _first_step(state: ServoState, sight: Sight, settings: ServoSettings) -> Twist:
    """Return eqs. (16)-(17); ``full`` holds e_au at the target until e_du is latched."""
    bearings = _bearings(state)
    e_current, e_desired = bearings.epipole_current, bearings.epipole_desired
    full = settings.law == 'full'
    gains = {
        'k1': settings.turn_gain if full else settings.k1,
        'k2': settings.k2,
        'exponent': settings.exponent,
    }
    if settings.finite_time:
        nu = laws.finite_time_controls(e_current, e_desired, **gains)
    else:
        target = _held_epipole(state, sight) if full and not state.latched else 0.0
        nu = laws.auxiliary_controls(e_current, e_desired, e_target=target, **gains)
    twist = laws.linearizing_control(
        e_current,
        e_desired,
        sigma=_sigma(state, settings),
        distance=state.distance,
        nu=(nu[0], 0.0) if state.latched else nu,
    )
    if not full:
        return twist
    bearing = bearing_desired(bearings)
    speed = laws.braking_speed(bearing, state.desired_rate, deceleration=settings.braking)
    return saturate(twist, max_linear=max(speed, CREEP), max_angular=math.inf)


def _second_step(state: ServoState, sight: Sight, settings: ServoSettings) -> Twist:
    """Return eqs. (21)-(22); ``full`` steers along the axis of the goal instead of u_2 = 0."""
    twist = laws.match_features(sight.difference, k_t=settings.k_t)
    if settings.law != 'full' or not settings.line_following:
        return twist
    linear = min(max(twist.linear, -settings.max_linear), settings.max_linear)
    return laws.follow_line(
        linear,
        lateral_offset(state, sight),
        sight.heading_error,
        look_ahead=settings.look_ahead,
        curvature=state.curvature,
    )


def _bearings(state: ServoState) -> Bearings:
    if state.sight is None or state.sight.bearings is None:
        raise ValueError('the first step needs bearings; classify should have said lost')
    return state.sight.bearings


def _sigma(state: ServoState, settings: ServoSettings) -> float:
    bearings = _bearings(state)
    if settings.law == 'paper':
        return laws.printed_sigma(bearings.epipole_current, bearings.epipole_desired)
    return bearings.sigma


def _switch(state: ServoState, sight: Sight, event: Event, settings: ServoSettings) -> ServoState:
    """Follow the transition table, and prepare what the new phase needs."""
    phase = next_phase(state.phase, event)
    if phase is state.phase:
        return state
    state = replace(
        state,
        phase=phase,
        phase_start_ns=sight.stamp_ns,
        run_start_ns=sight.stamp_ns if state.phase is Phase.WAITING else state.run_start_ns,
        settled=0,
        reason=_reason(state, sight, event, settings),
        attempts=state.attempts + (event is Event.MISSED),
    )
    if phase in (Phase.DISPLACING, Phase.ZEROING_EPIPOLES) and sight.bearings is not None:
        bearing = bearing_desired(sight.bearings)
        side = math.copysign(1.0, bearing)
        leg = Leg(sight.bearings.psi)
        state = replace(state, side=side, latched=False, leg=leg)
    if phase is Phase.DISPLACING:
        state = replace(state, target=_target(sight, settings))
    return state


def _target(sight: Sight, settings: ServoSettings) -> float:
    """Return where DISPLACING puts the current epipole (section IV-B, remarks; or discordant)."""
    bearings = sight.bearings
    if bearings is None:
        return 0.0
    if settings.law == 'full':
        return math.tan(displacement(sight, settings) or 0.0)
    return math.copysign(math.tan(2.0 * settings.singular_epipole), bearings.epipole_current)


def _reason(state: ServoState, sight: Sight, event: Event, settings: ServoSettings) -> str:
    """Say why a phase was left, for the log and for the verdict on the run."""
    name = state.phase.value
    run = seconds_between(state.run_start_ns, sight.stamp_ns)
    if event is Event.TIMED_OUT and run > settings.run_timeout:
        return f'the run took longer than {settings.run_timeout:g} s, still {name}'
    if event is Event.TIMED_OUT and state.phase is Phase.HOLDING:
        return f'tracks lost or untrusted for {settings.holding_timeout:g} s: {state.reason}'
    if event is Event.TIMED_OUT:
        return f'{name} took longer than {settings.phase_timeout:g} s'
    if event is Event.DIVERGED:
        return f'the desired epipole ran away to infinity in {name}'
    if event in (Event.MISSED, Event.EXHAUSTED):
        error = sight.feature_error * sight.focal
        return (
            f'features are {error:.1f} px off, parallax {sight.parallax_px:.1f} px, '
            f'at the end of attempt {state.attempts}'
        )
    if event is Event.LOST:
        return sight.reason or f'bearings not trusted in {name}'
    return str(event.value)
