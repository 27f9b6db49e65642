"""
Phase commands: the velocity that each phase asks for, the paper's equations and what departs.

Which departures are taken is data: ``control.law_table.LawOptions``. All of it is pure: the state
in, the wanted twist out, before limits, ramps and the dead band.
"""

from collections.abc import Callable, Mapping
from dataclasses import replace
import math

from visual_servo_epipolar.core.control import laws
from visual_servo_epipolar.core.control.gains import UNHURRIED
from visual_servo_epipolar.core.control.law_table import epipole_controls, matching_control
from visual_servo_epipolar.core.geometry.epipolar import Bearings
from visual_servo_epipolar.core.geometry.motion import saturate, STANDSTILL, Twist
from visual_servo_epipolar.core.perception.measurement import Measurement
from visual_servo_epipolar.core.servo.phases.table import Phase
from visual_servo_epipolar.core.servo.ranging import look_ahead
from visual_servo_epipolar.core.servo.settings import ServoSettings
from visual_servo_epipolar.core.servo.state import ServoState
from visual_servo_epipolar.core.servo.update import lateral_offset

CREEP = 0.02  # braking never asks for less, lest noise in the rate stop the robot [m/s]


def wanted_twist(state: ServoState, settings: ServoSettings) -> Twist:
    """Return the velocity that the law of the phase asks for, before saturation."""
    if state.measurement is None:
        return STANDSTILL
    return COMMANDS[state.phase](state, state.measurement, settings)


def straightened(wanted: Twist, state: ServoState, settings: ServoSettings) -> Twist:
    """Return ``wanted`` without the turn that unequal wheels are known to add to it."""
    if not settings.options.curvature_feedforward:
        return wanted
    return replace(wanted, angular=wanted.angular - state.curvature.value * wanted.linear)


def _stand(state: ServoState, measurement: Measurement, settings: ServoSettings) -> Twist:
    return STANDSTILL


def _orient(state: ServoState, measurement: Measurement, settings: ServoSettings) -> Twist:
    """Turn to the goal's heading."""
    return laws.turn_to_heading(measurement.heading_error, gain=settings.turn_gain)


def _retreat(state: ServoState, measurement: Measurement, settings: ServoSettings) -> Twist:
    """Turn to the goal's heading as far as the view allows, then back off."""
    left, right = measurement.view_margins
    allowed = min(max(-measurement.heading_error, -right), left)
    turning = abs(allowed) > settings.retreat_heading
    turn = laws.turn_to_heading(-allowed, gain=settings.turn_gain)
    return replace(turn, linear=0.0 if turning else -settings.retreat_speed)


def _displace(state: ServoState, measurement: Measurement, settings: ServoSettings) -> Twist:
    """Turn in place until the current epipole is at its target (section IV-B, remarks)."""
    if measurement.bearings is None:
        return STANDSTILL
    return laws.turn_epipole(
        measurement.bearings.epipole_current, state.target, k1=settings.turn_gain
    )


def _held_epipole(state: ServoState, measurement: Measurement) -> float:
    """Return where to hold e_au: at the target, but never so that features leave the view."""
    if measurement.bearings is None:
        return state.target
    here, (left, right) = measurement.bearings.alpha, measurement.view_margins
    wanted = math.atan(state.target)
    return math.tan(min(max(wanted, here - right), here + left))


def _first_step(state: ServoState, measurement: Measurement, settings: ServoSettings) -> Twist:
    """Return eqs. (16)-(17), with e_au held at the target until e_du is latched, and braking."""
    bearings, law = measurement.bearings, settings.options
    if bearings is None:
        return STANDSTILL
    gains = _first_gains(state, settings)
    if law.discordant_turn and not state.latched and not settings.finite_time:
        gains['e_target'] = _held_epipole(state, measurement)
    controls = epipole_controls(law, finite_time=settings.finite_time)
    nu = controls(bearings.epipole_current, bearings.epipole_desired, **gains)
    twist = laws.linearizing_control(
        bearings.epipole_current,
        bearings.epipole_desired,
        sigma=_sigma(bearings, settings),
        distance=state.distance,
        nu=(nu[0], 0.0) if state.latched else nu,
    )
    if not law.contact_braking:
        return twist
    speed = laws.braking_speed(bearings.chi, state.desired_rate, deceleration=settings.braking)
    return saturate(twist, max_linear=max(speed, CREEP), max_angular=math.inf)


def _second_step(state: ServoState, measurement: Measurement, settings: ServoSettings) -> Twist:
    """Return eqs. (21)-(22), or the same speed along the axis of the goal instead of u_2 = 0."""
    control, gain = (
        matching_control(settings.options),
        _matching_gain(state, measurement, settings),
    )
    twist = control(measurement.difference, k_t=gain)
    if not settings.options.line_following:
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
    derived, held = state.gains, settings.options.discordant_turn
    k1 = settings.turn_gain if held else settings.k1
    if derived is None:
        return {'k1': k1, 'k2': settings.k2, 'exponent': settings.exponent}
    k1 = min(k1, derived.k1_alone) if held else derived.k1
    if state.latched and not held:
        k1 = derived.k1_alone
    return {'k1': k1, 'k2': derived.k2, 'exponent': derived.exponent}


def _matching_gain(state: ServoState, measurement: Measurement, settings: ServoSettings) -> float:
    """Return k_t of (21), or what closes in at a rate once D has shown its slope."""
    derived = state.gains
    k_t = settings.k_t if derived is None else derived.k_t
    if not settings.options.slope_gain or not state.slope.value > 0.0:
        return k_t
    factor = laws.adaptive_gain(
        measurement.difference, at_zero=settings.gain_at_goal, far=1.0, slope=settings.gain_slope
    )
    rate = settings.approach_rate
    rate = min(k_t * state.slope.value, rate) if derived is None else min(derived.rate, rate)
    return _unhurried(factor * rate, rate, state, settings) / state.slope.value


def _unhurried(wanted: float, least: float, state: ServoState, settings: ServoSettings) -> float:
    """Return the rate ``wanted`` [1/s] as far as the delay allows, ``least`` at least."""
    delay = settings.latency + (state.period if state.period > 0.0 else 0.0)
    return min(wanted, max(least, UNHURRIED / max(delay, 1e-3)))


def _sigma(bearings: Bearings, settings: ServoSettings) -> float:
    if settings.options.true_sigma:
        return bearings.sigma
    return laws.printed_sigma(bearings.epipole_current, bearings.epipole_desired)


COMMANDS: Mapping[Phase, Callable[[ServoState, Measurement, ServoSettings], Twist]] = {
    Phase.WAITING: _stand,
    Phase.ORIENTING: _orient,
    Phase.RETREATING: _retreat,
    Phase.DISPLACING: _displace,
    Phase.ZEROING_EPIPOLES: _first_step,
    Phase.MATCHING_FEATURES: _second_step,
    Phase.ARRIVED: _stand,
    Phase.HOLDING: _stand,
    Phase.FAILED: _stand,
}
