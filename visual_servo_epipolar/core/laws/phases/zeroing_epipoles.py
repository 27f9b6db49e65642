"""Zeroing epipoles: step 1, onto the axis of the photograph, eqs. (16)-(17)."""

import math

from visual_servo_epipolar.core.estimate.settings import DriveSettings
from visual_servo_epipolar.core.geometry.epipolar import Bearings
from visual_servo_epipolar.core.geometry.motion import saturate, STANDSTILL, Twist
from visual_servo_epipolar.core.laws.braking import braked_turn
from visual_servo_epipolar.core.laws.law import epipole_controls
from visual_servo_epipolar.core.laws.machine import PhaseRow
from visual_servo_epipolar.core.laws.phase import Event, Phase
from visual_servo_epipolar.core.laws.phases.bounds import (
    align_bound,
    engage_bound,
    hysteresis,
    release_bound,
)
from visual_servo_epipolar.core.laws.phases.conditions import (
    begun_step_1,
    is_off_course,
    leads_home,
    offset_ratio,
    with_new_leg,
)
from visual_servo_epipolar.core.laws.state import ServoState
from visual_servo_epipolar.core.laws.two_steps import equations
from visual_servo_epipolar.core.laws.two_steps.derived_gains import gains_in_use, with_gains_of_now
from visual_servo_epipolar.core.odometry.ranging import UNKNOWN_RANGE
from visual_servo_epipolar.core.perception.measurement import Measurement

CREEP = 0.02  # least speed under contact braking, lest noise in the rate stop the robot [m/s]
YAW_FOR_NEW_START = math.radians(1.5)  # that the camera may be learnt to differ by in this phase
RESIDUAL_OFFSET = 1e-3  # at the end of line following [m]
LARGEST_ESCAPE = 0.1  # [rad]


def _classify(state: ServoState, measurement: Measurement, settings: DriveSettings) -> Event:
    if measurement.bearings is None:
        return Event.NO_BASELINE if measurement.parallax <= settings.near_parallax else Event.LOST
    chi = measurement.bearings.chi
    if abs(chi) >= settings.divergence:
        return Event.DIVERGED
    factor = hysteresis(state, settings)
    turned = state.yaw_learnt > factor * YAW_FOR_NEW_START
    off_course = is_off_course(measurement, settings, factor=factor)
    if not state.law.latched and not turned and off_course:
        return Event.ALIGNED if leads_home(measurement, settings) else Event.SIDEWAYS
    if state.law.latched:
        escaped = abs(chi) > escape_bound(state, measurement, settings)
    else:
        escaped = leads_away(measurement, settings, factor=factor)
    if escaped or (turned and not _goes_on(state, measurement, settings)):
        return begun_step_1(measurement, settings, Event.ESCAPED)
    return Event.ALIGNED if state.settling.settled >= settings.align_frames else Event.NOTHING


def _goes_on(state: ServoState, measurement: Measurement, settings: DriveSettings) -> bool:
    """Return whether step 1 leads home as it is, though the yaw of the camera is another."""
    if not settings.options.line_following or measurement.bearings is None:
        return False
    if state.law.latched:
        return True
    # The spiral of the held e_au, as in ``equations.displaced_epipole``.
    least_tangent = abs(measurement.bearings.chi) / math.log(1.0 / settings.least_spiral_ratio)
    return abs(state.law.target) >= least_tangent and not is_off_course(measurement, settings)


def escape_bound(state: ServoState, measurement: Measurement, settings: DriveSettings) -> float:
    """
    Return the bearing of e_du [rad] beyond which step 1 has to begin anew.

    An offset that line following brings below a millimetre need not be zeroed first, as when a
    camera ahead of the axle swings aside while the robot turns: to begin anew would displace e_au
    by as much, and the camera would swing aside once more.
    """
    bound = hysteresis(state, settings) * release_bound(measurement, settings)
    if not settings.options.line_following:
        return bound
    if measurement.offset is None:
        motion = state.motion
        distance = motion.range if motion.range > 0.0 else min(motion.distance, UNKNOWN_RANGE)
    else:
        distance = math.hypot(*measurement.offset)
    most = RESIDUAL_OFFSET / max(offset_ratio(distance, measurement, settings), 1e-9)
    return max(bound, min(most / distance, LARGEST_ESCAPE))


def leads_away(measurement: Measurement, settings: DriveSettings, *, factor: float = 1.0) -> bool:
    """
    Return whether both epipoles are on one side, from where step 1 drives away from the goal.

    e_au is turned to the other side first, but on the sign that e_du had then: it may have been
    lost in noise, or that of a mount that was taken for another.
    """
    law, bearings = settings.options, measurement.bearings
    if bearings is None or not (law.discordant_turn and law.retreat):
        return False
    known = abs(bearings.chi) > factor * release_bound(measurement, settings)
    return known and bearings.alpha * bearings.chi > 0.0


def _command(state: ServoState, measurement: Measurement, settings: DriveSettings) -> Twist:
    """Return eqs. (16)-(17), braked before contact if the law says so."""
    bearings, law = measurement.bearings, settings.options
    if bearings is None:
        return STANDSTILL
    if state.law.latched and _turns_back(state, settings):
        return Twist(0.0, braked_turn(-bearings.alpha, state, settings))
    nu = _auxiliary_controls(bearings, state, measurement, settings)
    twist = equations.linearizing_control(
        bearings.epipole_current,
        bearings.epipole_desired,
        sigma=_sigma(bearings, settings),
        distance=state.motion.distance,
        nu=(nu[0], 0.0) if state.law.latched else nu,
    )
    if not law.contact_braking:
        return twist
    rate, braking = state.law.desired_rate, settings.braking
    speed = equations.braking_speed(bearings.chi, rate, deceleration=braking)
    return saturate(twist, max_linear=max(speed, CREEP), max_angular=math.inf)


def _turns_back(state: ServoState, settings: DriveSettings) -> bool:
    """Return whether a turn in place that brakes zeroes e_au, not the controls of the law."""
    own = settings.options.epipole_controls is None and gains_in_use(state, settings) is None
    return own and settings.options.speed_ramps


def _auxiliary_controls(
    bearings: Bearings, state: ServoState, measurement: Measurement, settings: DriveSettings
) -> tuple[float, float]:
    """Return (nu_1, nu_2) of the law; a discordant turn holds e_au until e_du is latched."""
    law = settings.options
    gains = _first_gains(state, settings)
    if law.discordant_turn and not state.law.latched and not settings.finite_time:
        gains['e_target'] = _held_epipole(state, measurement)
    controls = epipole_controls(law, finite_time=settings.finite_time)
    return controls(bearings.epipole_current, bearings.epipole_desired, **gains)


def _first_gains(state: ServoState, settings: DriveSettings) -> dict[str, float]:
    """Return k1, k2 and the exponent of (12), given or derived; a held e_au has the turn gain."""
    derived, holds = gains_in_use(state, settings), settings.options.discordant_turn
    k1 = settings.turn_gain if holds else settings.k1
    if derived is None:
        return {'k1': k1, 'k2': settings.k2, 'exponent': settings.exponent}
    if holds:
        k1 = min(k1, derived.k1_alone)
    else:
        k1 = derived.k1_alone if state.law.latched else derived.k1
    return {'k1': k1, 'k2': derived.k2, 'exponent': derived.exponent}


def _held_epipole(state: ServoState, measurement: Measurement) -> float:
    """Return the abscissa to hold e_au at: the target, as far as features stay in view."""
    if measurement.bearings is None:
        return state.law.target
    alpha, (left, right) = measurement.bearings.alpha, measurement.view_margins
    return math.tan(min(max(math.atan(state.law.target), alpha - right), alpha + left))


def _sigma(bearings: Bearings, settings: DriveSettings) -> float:
    """Return sign cos(psi - theta), or the sign that the paper prints."""
    if settings.options.true_sigma:
        return bearings.sigma
    return equations.printed_sigma(bearings.epipole_current, bearings.epipole_desired)


def _is_settled(state: ServoState, measurement: Measurement, settings: DriveSettings) -> bool:
    """Return whether both epipoles are zero, or so small that step 2 leads home from here."""
    if not state.law.latched or measurement.bearings is None:
        return False
    if _turns_back(state, settings) and leads_home(measurement, settings):
        return True
    return abs(measurement.bearings.alpha) <= align_bound(measurement, settings)


def _begin(state: ServoState, measurement: Measurement, settings: DriveSettings) -> ServoState:
    """Return ``state`` with a new leg, and its derived gains; ValueError if none is legal."""
    state = with_new_leg(state, measurement)
    return with_gains_of_now(state, measurement, settings) if settings.derives else state


def _observe(state: ServoState, measurement: Measurement, settings: DriveSettings) -> ServoState:
    """Latch e_du at zero, once it is small or of the other sign, until a new phase."""
    if state.law.latched or measurement.bearings is None:
        return state
    bearing = measurement.bearings.chi
    near = abs(bearing) <= engage_bound(measurement, settings)
    return state.changed(latched=near or bearing * state.law.side < 0.0)


ZEROING_EPIPOLES = PhaseRow(
    phase=Phase.ZEROING_EPIPOLES,
    words='drives onto the axis of the photograph (step 1)',
    colour='#0072B2',
    classify=_classify,
    command=_command,
    is_settled=_is_settled,
    begin=_begin,
    observe=_observe,
)
