"""
Phase commands: the nominal velocity of each phase, by the paper's equations and departures.

The law says which departures are taken (``laws.registry.LawOptions``). Nominal is a twist
before limits, ramps and the dead band; twists are in m/s and rad/s.
"""

from collections.abc import Callable, Mapping
import math

from visual_servo_epipolar.core.geometry.epipolar import Bearings
from visual_servo_epipolar.core.geometry.motion import saturate, STANDSTILL, Twist
from visual_servo_epipolar.core.laws import equations
from visual_servo_epipolar.core.laws.gains import CRITICAL_GAIN_DELAY, Gains
from visual_servo_epipolar.core.laws.phases.lines import line_look_ahead
from visual_servo_epipolar.core.laws.phases.table import Phase
from visual_servo_epipolar.core.laws.registry import epipole_controls, matching_control
from visual_servo_epipolar.core.perception.measurement import Measurement
from visual_servo_epipolar.core.servo.identification.delay import felt_latency
from visual_servo_epipolar.core.servo.settings import ServoSettings
from visual_servo_epipolar.core.servo.state import ServoState
from visual_servo_epipolar.core.servo.update import lateral_offset

CREEP = 0.02  # least speed under contact braking, lest noise in the rate stop the robot [m/s]
LEAST_DELAY = 1e-3  # of a loop [s]


def nominal_twist(state: ServoState, settings: ServoSettings) -> Twist:
    """Return the nominal twist of the phase: that of its law, before saturation."""
    if state.measurement is None:
        return STANDSTILL
    return COMMANDS[state.phase](state, state.measurement, settings)


def curvature_compensated(twist: Twist, state: ServoState, settings: ServoSettings) -> Twist:
    """Return ``twist`` less the turn c u_1 that the identified curvature c would add to it."""
    if not settings.options.curvature_feedforward:
        return twist
    return Twist(twist.linear, twist.angular - state.curvature.value * twist.linear)


def _stand(state: ServoState, measurement: Measurement, settings: ServoSettings) -> Twist:
    return STANDSTILL


def _orient(state: ServoState, measurement: Measurement, settings: ServoSettings) -> Twist:
    """Return the turn in place to the goal's heading."""
    return equations.turn_to_heading(measurement.heading_error, gain=settings.turn_gain)


def _retreat(state: ServoState, measurement: Measurement, settings: ServoSettings) -> Twist:
    """Return the turn to the goal's heading as far as the view allows, then with backing off."""
    if settings.max_retreat == 0.0:
        return STANDSTILL
    left, right = measurement.view_margins
    angle = min(max(-measurement.heading_error, -right), left)
    turn = equations.turn_to_heading(-angle, gain=settings.turn_gain)
    turning = abs(angle) > settings.retreat_heading
    return Twist(0.0 if turning else -settings.retreat_speed, turn.angular)


def _displace(state: ServoState, measurement: Measurement, settings: ServoSettings) -> Twist:
    """Return the turn in place of e_au to its target (section IV-B, remarks)."""
    if measurement.bearings is None:
        return STANDSTILL
    return equations.turn_epipole(
        measurement.bearings.epipole_current, state.target, k1=settings.turn_gain
    )


def _held_epipole(state: ServoState, measurement: Measurement) -> float:
    """Return the abscissa to hold e_au at: the target, as far as features stay in view."""
    if measurement.bearings is None:
        return state.target
    alpha, (left, right) = measurement.bearings.alpha, measurement.view_margins
    return math.tan(min(max(math.atan(state.target), alpha - right), alpha + left))


def _first_step(state: ServoState, measurement: Measurement, settings: ServoSettings) -> Twist:
    """Return eqs. (16)-(17), braked before contact if the law says so."""
    bearings, law = measurement.bearings, settings.options
    if bearings is None:
        return STANDSTILL
    nu = _auxiliary_controls(bearings, state, measurement, settings)
    twist = equations.linearizing_control(
        bearings.epipole_current,
        bearings.epipole_desired,
        sigma=_sigma(bearings, settings),
        distance=state.distance,
        nu=(nu[0], 0.0) if state.latched else nu,
    )
    if not law.contact_braking:
        return twist
    rate, braking = state.desired_rate, settings.braking
    speed = equations.braking_speed(bearings.chi, rate, deceleration=braking)
    return saturate(twist, max_linear=max(speed, CREEP), max_angular=math.inf)


def _auxiliary_controls(
    bearings: Bearings, state: ServoState, measurement: Measurement, settings: ServoSettings
) -> tuple[float, float]:
    """Return (nu_1, nu_2) of the law; a discordant turn holds e_au until e_du is latched."""
    law = settings.options
    gains = _first_gains(state, settings)
    if law.discordant_turn and not state.latched and not settings.finite_time:
        gains['e_target'] = _held_epipole(state, measurement)
    controls = epipole_controls(law, finite_time=settings.finite_time)
    return controls(bearings.epipole_current, bearings.epipole_desired, **gains)


def _second_step(state: ServoState, measurement: Measurement, settings: ServoSettings) -> Twist:
    """Return eqs. (21)-(22), or their u_1 with line following instead of u_2 = 0."""
    control = matching_control(settings.options)
    twist = control(measurement.difference, k_t=_matching_gain(state, measurement, settings))
    if not settings.options.line_following:
        return twist
    linear = min(max(twist.linear, -settings.max_linear), settings.max_linear)
    return equations.follow_line(
        linear,
        lateral_offset(state, measurement),
        measurement.heading_error,
        look_ahead=line_look_ahead(state, measurement, settings),
    )


def _derived(state: ServoState, settings: ServoSettings) -> Gains | None:
    """Return the gains derived for this step, unless those given are to hold by now."""
    return state.gains if settings.derives else None


def _first_gains(state: ServoState, settings: ServoSettings) -> dict[str, float]:
    """Return k1, k2 and the exponent of (12), given or derived; a held e_au has the turn gain."""
    derived, holds = _derived(state, settings), settings.options.discordant_turn
    k1 = settings.turn_gain if holds else settings.k1
    if derived is None:
        return {'k1': k1, 'k2': settings.k2, 'exponent': settings.exponent}
    if holds:
        k1 = min(k1, derived.k1_alone)
    else:
        k1 = derived.k1_alone if state.latched else derived.k1
    return {'k1': k1, 'k2': derived.k2, 'exponent': derived.exponent}


def _matching_gain(state: ServoState, measurement: Measurement, settings: ServoSettings) -> float:
    """Return k_t of (21) [m/s]: given, derived, or a rate over the slope of D once it is known."""
    derived = _derived(state, settings)
    k_t = settings.k_t if derived is None else derived.k_t
    if not settings.options.slope_gain or not state.slope.value > 0.0:
        return k_t
    factor = equations.adaptive_gain(
        measurement.difference, at_zero=settings.gain_at_goal, far=1.0, slope=settings.gain_slope
    )
    rate = settings.approach_rate
    rate = min(k_t * state.slope.value, rate) if derived is None else min(derived.rate, rate)
    return min(factor * rate, max(rate, _damped_rate(state, settings))) / state.slope.value


def _damped_rate(state: ServoState, settings: ServoSettings) -> float:
    """Return the rate [1/s] that is critically damped under the delay of the loop."""
    delay = felt_latency(settings) + (state.period if state.period > 0.0 else 0.0)
    return CRITICAL_GAIN_DELAY / max(delay, LEAST_DELAY)


def _sigma(bearings: Bearings, settings: ServoSettings) -> float:
    """Return sign cos(psi - theta), or the sign that the paper prints."""
    if settings.options.true_sigma:
        return bearings.sigma
    return equations.printed_sigma(bearings.epipole_current, bearings.epipole_desired)


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
