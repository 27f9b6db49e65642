"""
What each phase does: its law, with the cures of law ``full`` around the paper's equations.

All of it is pure: the state in, the wanted twist out, before limits, ramps and the dead band.
"""

from dataclasses import replace
import math

from visual_servo_epipolar.core.control import laws
from visual_servo_epipolar.core.control.gains import UNHURRIED
from visual_servo_epipolar.core.geometry.epipolar import Bearings
from visual_servo_epipolar.core.geometry.motion import saturate, STANDSTILL, Twist
from visual_servo_epipolar.core.perception.perceive import Measurement
from visual_servo_epipolar.core.servo.phases.table import Phase
from visual_servo_epipolar.core.servo.ranging import look_ahead
from visual_servo_epipolar.core.servo.settings import ServoSettings
from visual_servo_epipolar.core.servo.state import ServoState
from visual_servo_epipolar.core.servo.update import lateral_offset

CREEP = 0.02  # braking never asks for less, lest noise in the rate stop the robot [m/s]


def command(state: ServoState, settings: ServoSettings) -> Twist:
    """Return the law of the phase, before saturation."""
    measurement = state.measurement
    if measurement is None:
        return STANDSTILL
    if state.phase is Phase.ORIENTING:
        return laws.turn_to_heading(measurement.heading_error, gain=settings.turn_gain)
    if state.phase is Phase.RETREATING:
        return _retreat(measurement, settings)
    if state.phase is Phase.MATCHING_FEATURES:
        return _second_step(state, measurement, settings)
    if measurement.bearings is None:
        return STANDSTILL
    if state.phase is Phase.DISPLACING:
        return laws.turn_epipole(
            measurement.bearings.epipole_current, state.target, k1=settings.turn_gain
        )
    if state.phase is Phase.ZEROING_EPIPOLES:
        return _first_step(state, measurement, settings)
    return STANDSTILL


def straightened(wanted: Twist, state: ServoState, settings: ServoSettings) -> Twist:
    """Return ``wanted`` without the turn that unequal wheels are known to add to it."""
    if settings.law != 'full':
        return wanted
    return replace(wanted, angular=wanted.angular - state.curvature.value * wanted.linear)


def _retreat(measurement: Measurement, settings: ServoSettings) -> Twist:
    """Turn to the goal's heading as far as the view allows, then back off."""
    left, right = measurement.room
    left_to_turn = -measurement.heading_error
    allowed = min(max(left_to_turn, -right), left)
    turning = abs(allowed) > settings.retreat_heading
    turn = laws.turn_to_heading(-allowed, gain=settings.turn_gain)
    return replace(turn, linear=0.0 if turning else -settings.retreat_speed)


def _held_epipole(state: ServoState, measurement: Measurement) -> float:
    """Return where to hold e_au: at the target, but never so that features leave the view."""
    if measurement.bearings is None:
        return state.target
    here, (left, right) = measurement.bearings.alpha, measurement.room
    wanted = math.atan(state.target)
    return math.tan(min(max(wanted, here - right), here + left))


def _first_step(state: ServoState, measurement: Measurement, settings: ServoSettings) -> Twist:
    """Return eqs. (16)-(17); ``full`` holds e_au at the target until e_du is latched."""
    bearings = _bearings(state)
    e_current, e_desired = bearings.epipole_current, bearings.epipole_desired
    full = settings.law == 'full'
    gains = _first_gains(state, settings)
    if settings.finite_time:
        nu = laws.finite_time_controls(e_current, e_desired, **gains)
    else:
        target = _held_epipole(state, measurement) if full and not state.latched else 0.0
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
    bearing = bearings.chi
    speed = laws.braking_speed(bearing, state.desired_rate, deceleration=settings.braking)
    return saturate(twist, max_linear=max(speed, CREEP), max_angular=math.inf)


def _second_step(state: ServoState, measurement: Measurement, settings: ServoSettings) -> Twist:
    """Return eqs. (21)-(22); ``full`` steers along the axis of the goal instead of u_2 = 0."""
    full = settings.law == 'full'
    twist = laws.match_features(
        measurement.difference, k_t=_matching_gain(state, measurement, settings)
    )
    if not full or not settings.line_following:
        return twist
    linear = min(max(twist.linear, -settings.max_linear), settings.max_linear)
    return laws.follow_line(
        linear,
        lateral_offset(state, measurement),
        measurement.heading_error,
        look_ahead=look_ahead(state.range, settings.look_ahead),
    )


def _first_gains(state: ServoState, settings: ServoSettings) -> dict[str, float]:
    """Return k1, k2 and the exponent of (12), given or derived."""
    k1 = settings.turn_gain if settings.law == 'full' else settings.k1
    found = state.gains
    if found is None:
        return {'k1': k1, 'k2': settings.k2, 'exponent': settings.exponent}
    k1 = min(k1, found.k1_alone) if settings.law == 'full' else found.k1
    if state.latched and settings.law != 'full':
        k1 = found.k1_alone
    return {'k1': k1, 'k2': found.k2, 'exponent': found.exponent}


def _matching_gain(state: ServoState, measurement: Measurement, settings: ServoSettings) -> float:
    """Return k_t of (21); ``full`` closes in at a rate, once it knows the slope of D."""
    found = state.gains
    k_t = settings.k_t if found is None else found.k_t
    if settings.law != 'full' or not state.slope.value > 0.0:
        return k_t
    factor = laws.adaptive_gain(
        measurement.difference, at_zero=settings.gain_at_goal, far=1.0, slope=settings.gain_slope
    )
    rate = settings.approach_rate
    rate = min(k_t * state.slope.value, rate) if found is None else min(found.rate, rate)
    return _unhurried(factor * rate, rate, state, settings) / state.slope.value


def _unhurried(wanted: float, least: float, state: ServoState, settings: ServoSettings) -> float:
    """Return the rate ``wanted`` [1/s] as far as the delay allows, ``least`` at least."""
    delay = settings.latency + (state.period if state.period > 0.0 else 0.0)
    return min(wanted, max(least, UNHURRIED / max(delay, 1e-3)))


def _bearings(state: ServoState) -> Bearings:
    if state.measurement is None or state.measurement.bearings is None:
        raise ValueError('the first step needs bearings; classify should have said lost')
    return state.measurement.bearings


def _sigma(state: ServoState, settings: ServoSettings) -> float:
    bearings = _bearings(state)
    if settings.law == 'paper':
        return laws.printed_sigma(bearings.epipole_current, bearings.epipole_desired)
    return bearings.sigma
