"""Matching features: step 2, which drives straight until the features match, eqs. (21)-(22)."""

import math

from visual_servo_epipolar.core.estimate.settings import DriveSettings
from visual_servo_epipolar.core.geometry.motion import Twist
from visual_servo_epipolar.core.laws.braking import (
    braked,
    BRAKING,
    converging_speed,
    heading_share,
    LEAST_LOOK_AHEAD,
    looking_speed,
    settled_turn,
    STEERING_S,
    unfelt_latency,
)
from visual_servo_epipolar.core.laws.law import matching_control
from visual_servo_epipolar.core.laws.machine import PhaseRow
from visual_servo_epipolar.core.laws.phase import Event, Phase
from visual_servo_epipolar.core.laws.phases.arrival import (
    faces_goal,
    has_parallax,
    is_in_doubt,
    is_near_enough,
    stands_aside,
)
from visual_servo_epipolar.core.laws.phases.bounds import FACING, is_matched, trial_of
from visual_servo_epipolar.core.laws.phases.conditions import (
    is_untrusted,
    lateral_offset,
    line_look_ahead,
)
from visual_servo_epipolar.core.laws.state import ServoState
from visual_servo_epipolar.core.laws.timing import felt_latency
from visual_servo_epipolar.core.laws.two_steps import equations
from visual_servo_epipolar.core.laws.two_steps.derived_gains import gains_in_use, with_gains_of_now
from visual_servo_epipolar.core.laws.two_steps.gains import CRITICAL_GAIN_DELAY
from visual_servo_epipolar.core.perception.measurement import Measurement

DOUBTFUL_LOOKS = 3  # times the frames of one that is sure: the noise has to be known
YAW_FOR_NEW_ATTEMPT = math.radians(0.5)  # that the camera is learnt to differ by in this phase
LEAST_DELAY = 1e-3  # of a loop [s]


def _classify(state: ServoState, measurement: Measurement, settings: DriveSettings) -> Event:
    if is_untrusted(measurement, settings):
        return Event.LOST
    if state.settling.settled < _looks(state, measurement, settings) * settings.arrival_frames:
        return Event.NOTHING
    attempts_remain = state.run.attempts < settings.max_attempts
    repeats = settings.options.new_attempts and attempts_remain
    missed = Event.MISSED if repeats else Event.EXHAUSTED
    if has_parallax(state, measurement, settings):
        # Within a tolerance of the owner's alone it is no miss: it goes on, nearer.
        return missed if is_matched(measurement, settings, trial_of(state)) else Event.NOTHING
    if repeats and measurement.offset is None and state.yaw_learnt > YAW_FOR_NEW_ATTEMPT:
        return Event.MISSED  # aside by as much as two views cannot tell
    if faces_goal(state, measurement, settings):
        return Event.MATCHED
    if settings.options.final_turn:
        return Event.TURNED
    return missed if settings.arrival_heading > FACING else Event.MATCHED


def _looks(state: ServoState, measurement: Measurement, settings: DriveSettings) -> int:
    """Return how many times the usual frames decide whether this is the goal."""
    if not is_in_doubt(measurement, settings) or stands_aside(state, measurement, settings):
        return 1
    return DOUBTFUL_LOOKS


def _command(state: ServoState, measurement: Measurement, settings: DriveSettings) -> Twist:
    """Return eqs. (21)-(22), or their u_1 with line following instead of u_2 = 0."""
    control, difference = matching_control(settings.options), measurement.difference
    if _brakes(state, settings):
        difference += state.motion.slope.value * state.twist.linear * unfelt_latency(settings)
    twist = control(difference, k_t=_matching_gain(difference, state, settings))
    if not settings.options.line_following:
        return twist
    fastest = min(settings.max_linear, _converging_speed(state, measurement, settings))
    linear = min(max(twist.linear, -settings.max_linear), fastest)
    twist = equations.follow_line(
        linear,
        lateral_offset(state, measurement),
        measurement.heading_error,
        look_ahead=_look_ahead(abs(linear), state, measurement, settings),
    )
    if (
        not _brakes(state, settings)
        or measurement.offset is None
        or not settings.options.final_turn
    ):
        return twist
    facing = heading_share(measurement.offset[1])
    turn = settled_turn(-measurement.heading_error, state, settings)
    return Twist(linear, (1.0 - facing) * twist.angular + facing * turn)


def _converging_speed(
    state: ServoState, measurement: Measurement, settings: DriveSettings
) -> float:
    """Return the speed at which line following ends on the axis, as a memory knows it [m/s]."""
    if measurement.offset is None or not _brakes(state, settings):
        return math.inf
    x, y = measurement.offset
    if y >= 0.0:
        return math.inf
    braking = BRAKING * settings.max_acceleration
    aside = abs(x) + LEAST_LOOK_AHEAD * abs(measurement.heading_error)
    speed = converging_speed(aside, -y, state, braking, 1.0)
    return min(speed, looking_speed(-y, state, settings))


def _look_ahead(
    speed: float, state: ServoState, measurement: Measurement, settings: DriveSettings
) -> float:
    """Return the look-ahead of line following [m], in time no less than a loop can follow."""
    length = line_look_ahead(state, measurement, settings)
    return max(length, STEERING_S * speed) if _brakes(state, settings) else length


def _matching_gain(difference: float, state: ServoState, settings: DriveSettings) -> float:
    """Return k_t of (21) [m/s]: given, derived, or a rate over the slope of D once it is known."""
    derived = gains_in_use(state, settings)
    k_t = settings.k_t if derived is None else derived.k_t
    if not settings.options.slope_gain or not state.motion.slope.value > 0.0:
        return k_t
    factor = equations.adaptive_gain(
        difference, at_zero=settings.gain_at_goal, far=1.0, slope=settings.gain_slope
    )
    rate = settings.approach_rate
    rate = (
        min(k_t * state.motion.slope.value, rate) if derived is None else min(derived.rate, rate)
    )
    rate = min(factor * rate, max(rate, _damped_rate(state, settings)))
    if _brakes(state, settings):
        rate = _braked_rate(rate, difference / state.motion.slope.value, state, settings)
    return rate / state.motion.slope.value


def _brakes(state: ServoState, settings: DriveSettings) -> bool:
    """Return whether step 2 ends at a constant deceleration: its way is known, gains are given."""
    law = settings.options
    known = law.slope_gain and state.motion.slope.value > 0.0
    return known and law.speed_ramps and not settings.derives


def _braked_rate(rate: float, way: float, state: ServoState, settings: DriveSettings) -> float:
    """Return the speed over the ``way`` left [1/s] that brakes in time, near its end that rate."""
    if way == 0.0:
        return rate
    deceleration, band = BRAKING * settings.max_acceleration, settings.dead_band_linear
    return braked(way, state, gain=rate, deceleration=deceleration, dead_band=band) / way


def _damped_rate(state: ServoState, settings: DriveSettings) -> float:
    """Return the rate [1/s] that is critically damped under the delay of the loop."""
    delay = felt_latency(settings) + (state.view.period if state.view.period > 0.0 else 0.0)
    return CRITICAL_GAIN_DELAY / max(delay, LEAST_DELAY)


def _is_settled(state: ServoState, measurement: Measurement, settings: DriveSettings) -> bool:
    matched = is_matched(measurement, settings, trial_of(state))
    return matched or is_near_enough(state, measurement, settings)


def _is_close(state: ServoState, measurement: Measurement, settings: DriveSettings) -> bool:
    return is_matched(measurement, settings, trial_of(state, spent=True))


def _begin(state: ServoState, measurement: Measurement, settings: DriveSettings) -> ServoState:
    """Return ``state`` with its derived gains, if any; ValueError if none is legal."""
    return with_gains_of_now(state, measurement, settings) if settings.derives else state


MATCHING_FEATURES = PhaseRow(
    phase=Phase.MATCHING_FEATURES,
    words='drives straight until the features match (step 2)',
    colour='#009E73',
    classify=_classify,
    command=_command,
    is_settled=_is_settled,
    is_close=_is_close,
    begin=_begin,
)
