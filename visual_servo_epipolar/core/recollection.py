"""What the servo learns from one image to the next: distance, rates, latch, curvature."""

from dataclasses import replace
import math

from visual_servo_epipolar.core import laws
from visual_servo_epipolar.core.learning import Slope
from visual_servo_epipolar.core.perception import Sight
from visual_servo_epipolar.core.phases import Phase
from visual_servo_epipolar.core.ranging import Leg, MIN_TURN, UNKNOWN_RANGE
from visual_servo_epipolar.core.servo_settings import ServoSettings
from visual_servo_epipolar.core.servo_state import ServoState
from visual_servo_epipolar.core.situation import bearing_desired, engage_bound, is_settled
from visual_servo_epipolar.core.stamps import seconds_between

MAX_STEP_S = 1.0  # a longer gap between two images is not integrated over
RATE_SMOOTHING = 0.4
RANGE_SMOOTHING = 0.2
PERIOD_SMOOTHING = 0.1
MIN_SPEED = 0.05  # below, the way says nothing about the range [m/s]
TURN_DEVIATIONS = 8.0  # of a bearing, that the line of sight must have turned by


def interval(earlier_ns: int, later_ns: int) -> float:
    """Return the time to integrate over between two images [s]."""
    return min(max(seconds_between(earlier_ns, later_ns), 0.0), MAX_STEP_S)


def remember(state: ServoState, sight: Sight, settings: ServoSettings) -> ServoState:
    """Take in what was seen, before it is classified."""
    before = state.sight
    dt = 0.0 if before is None else interval(before.stamp_ns, sight.stamp_ns)
    leg = _leg(state, dt)
    state = replace(
        state,
        distance=_distance(state, dt, settings),
        leg=leg,
        period=_period(state, dt),
        range=_range(state, sight, leg, dt),
        desired_rate=_desired_rate(state, sight, dt),
        curvature=state.curvature.learnt(
            before, sight, state.twist, dt, drift=settings.curvature_drift
        ),
        slope=_slope(state, sight, dt),
        latched=_latch(state, sight, settings),
        sight=sight,
    )
    return _with_settled(state, sight, settings)


def _with_settled(state: ServoState, sight: Sight, settings: ServoSettings) -> ServoState:
    """Count the frames that fulfil the aim of the phase, and average their parallax."""
    if not is_settled(state, settings):
        return replace(state, settled=0) if state.settled else state
    settled = state.settled + 1
    earlier = state.settled_parallax if state.settled else 0.0
    square = earlier**2 + (sight.parallax**2 - earlier**2) / settled
    return replace(state, settled=settled, settled_parallax=math.sqrt(max(square, 0.0)))


def lateral_offset(state: ServoState, sight: Sight) -> float:
    """Return x [m], right positive, as the baseline shows it; 0 without bearings."""
    if sight.bearings is None:
        return 0.0
    distance = min(state.distance, UNKNOWN_RANGE) if math.isnan(state.range) else state.range
    return distance * math.cos(sight.bearings.psi)


def _distance(state: ServoState, dt: float, settings: ServoSettings) -> float:
    """Integrate d_hat by the applied speed (18)."""
    if math.isnan(state.distance):
        return max(settings.initial_distance, settings.min_distance)
    before = state.sight
    if before is None or before.bearings is None:
        return state.distance
    # sigma of the geometry itself, also under the printed law: this is kinematics.
    rate = laws.distance_rate(
        state.twist.linear, before.bearings.epipole_current, sigma=before.bearings.sigma
    )
    return max(state.distance + rate * dt, settings.min_distance)


def _period(state: ServoState, dt: float) -> float:
    """Return the time between two images [s], smoothed."""
    if math.isnan(state.period):
        return dt or math.nan
    return state.period + PERIOD_SMOOTHING * (dt - state.period)


def _leg(state: ServoState, dt: float) -> Leg | None:
    if state.leg is None or state.sight is None or state.sight.bearings is None:
        return state.leg
    return state.leg.extended(state.sight.bearings, state.twist.linear * dt)


def _range(state: ServoState, sight: Sight, leg: Leg | None, dt: float) -> float:
    """Return the measured distance to the goal [m], carried on by the commands in between."""
    before = state.sight
    driven = state.range
    if before is not None and before.bearings is not None:
        driven += state.twist.linear * math.cos(before.bearings.phi) * dt
    measured, moving = None, abs(state.twist.linear) >= MIN_SPEED
    if leg is not None and sight.bearings is not None and state.phase is Phase.ZEROING_EPIPOLES:
        # At a standstill nothing new is learnt, and noise would be taken for news.
        uncertain = 0.0 if math.isnan(sight.deviation) else sight.deviation
        least = max(MIN_TURN, TURN_DEVIATIONS * uncertain)
        measured = leg.distance(sight.bearings.psi, min_turn=least) if moving else None
    if measured is None:
        return driven if math.isnan(driven) else max(driven, 0.0)
    return measured if math.isnan(driven) else driven + RANGE_SMOOTHING * (measured - driven)


def _desired_rate(state: ServoState, sight: Sight, dt: float) -> float:
    before = state.sight
    if before is None or before.bearings is None or sight.bearings is None or dt == 0.0:
        return 0.0
    rate = (bearing_desired(sight.bearings) - bearing_desired(before.bearings)) / dt
    return state.desired_rate + RATE_SMOOTHING * (rate - state.desired_rate)


def _slope(state: ServoState, sight: Sight, dt: float) -> Slope:
    if state.phase is not Phase.MATCHING_FEATURES or state.sight is None:
        return state.slope
    return state.slope.learnt(sight.difference - state.sight.difference, state.twist.linear * dt)


def _latch(state: ServoState, sight: Sight, settings: ServoSettings) -> bool:
    """Call e_du zero once it is small or has crossed; only a new phase lets go of it (escaped)."""
    if state.phase is not Phase.ZEROING_EPIPOLES or sight.bearings is None:
        return state.latched
    bearing = bearing_desired(sight.bearings)
    near = abs(bearing) <= engage_bound(sight, settings)
    return state.latched or near or bearing * state.side < 0.0
