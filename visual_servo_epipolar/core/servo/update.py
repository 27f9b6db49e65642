"""The update of the state by a measurement: distance, rates, latch, what driving identifies."""

from dataclasses import replace
import math

from visual_servo_epipolar.core.control import laws
from visual_servo_epipolar.core.perception.measurement import Measurement
from visual_servo_epipolar.core.servo.identification import Slope
from visual_servo_epipolar.core.servo.phases.conditions import (
    engage_bound,
    is_settled,
)
from visual_servo_epipolar.core.servo.phases.table import Phase
from visual_servo_epipolar.core.servo.ranging import Leg, MIN_TURN, UNKNOWN_RANGE
from visual_servo_epipolar.core.servo.settings import ServoSettings
from visual_servo_epipolar.core.servo.state import ServoState
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


def updated(state: ServoState, measurement: Measurement, settings: ServoSettings) -> ServoState:
    """Return the state after it took a ``measurement`` in, before it is classified."""
    before = state.measurement
    dt = 0.0 if before is None else interval(before.stamp_ns, measurement.stamp_ns)
    leg = _leg(state, dt)
    state = replace(
        state,
        distance=_distance(state, dt, settings),
        leg=leg,
        period=_period(state, dt),
        range=_range(state, measurement, leg, dt),
        desired_rate=_desired_rate(state, measurement, dt),
        curvature=state.curvature.learnt(
            before, measurement, state.twist, dt, drift=settings.curvature_drift
        ),
        slope=_slope(state, measurement, dt),
        latched=_latch(state, measurement, settings),
        measurement=measurement,
    )
    return _with_settled(state, measurement, settings)


def _with_settled(
    state: ServoState, measurement: Measurement, settings: ServoSettings
) -> ServoState:
    """Count the frames that fulfil the aim of the phase, and average their parallax."""
    if not is_settled(state, settings):
        return replace(state, settled=0) if state.settled else state
    settled = state.settled + 1
    earlier = state.settled_parallax if state.settled else 0.0
    square = earlier**2 + (measurement.parallax**2 - earlier**2) / settled
    return replace(state, settled=settled, settled_parallax=math.sqrt(max(square, 0.0)))


def lateral_offset(state: ServoState, measurement: Measurement) -> float:
    """Return x [m], right positive, as the baseline shows it; 0 without bearings."""
    if measurement.bearings is None:
        return 0.0
    distance = min(state.distance, UNKNOWN_RANGE) if math.isnan(state.range) else state.range
    return distance * math.cos(measurement.bearings.psi)


def _distance(state: ServoState, dt: float, settings: ServoSettings) -> float:
    """Integrate d_hat by the applied speed (18)."""
    if math.isnan(state.distance):
        return max(settings.initial_distance, settings.min_distance)
    before = state.measurement
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
    if state.leg is None or state.measurement is None or state.measurement.bearings is None:
        return state.leg
    return state.leg.extended(state.measurement.bearings, state.twist.linear * dt)


def _range(state: ServoState, measurement: Measurement, leg: Leg | None, dt: float) -> float:
    """Return the measured distance to the goal [m], carried on by the commands in between."""
    before = state.measurement
    driven = state.range
    if before is not None and before.bearings is not None:
        driven += state.twist.linear * math.cos(before.bearings.phi) * dt
    measured, moving = None, abs(state.twist.linear) >= MIN_SPEED
    if (
        leg is not None
        and measurement.bearings is not None
        and state.phase is Phase.ZEROING_EPIPOLES
    ):
        # At a standstill nothing new is learnt, and noise would be taken for news.
        uncertain = 0.0 if math.isnan(measurement.deviation) else measurement.deviation
        least = max(MIN_TURN, TURN_DEVIATIONS * uncertain)
        measured = leg.distance(measurement.bearings.psi, min_turn=least) if moving else None
    if measured is None:
        return driven if math.isnan(driven) else max(driven, 0.0)
    return measured if math.isnan(driven) else driven + RANGE_SMOOTHING * (measured - driven)


def _desired_rate(state: ServoState, measurement: Measurement, dt: float) -> float:
    before = state.measurement
    if before is None or before.bearings is None or measurement.bearings is None or dt == 0.0:
        return 0.0
    rate = (measurement.bearings.chi - before.bearings.chi) / dt
    return state.desired_rate + RATE_SMOOTHING * (rate - state.desired_rate)


def _slope(state: ServoState, measurement: Measurement, dt: float) -> Slope:
    if state.phase is not Phase.MATCHING_FEATURES or state.measurement is None:
        return state.slope
    return state.slope.learnt(
        measurement.difference - state.measurement.difference, state.twist.linear * dt
    )


def _latch(state: ServoState, measurement: Measurement, settings: ServoSettings) -> bool:
    """Call e_du zero once it is small or has crossed; only a new phase lets go of it (escaped)."""
    if state.phase is not Phase.ZEROING_EPIPOLES or measurement.bearings is None:
        return state.latched
    bearing = measurement.bearings.chi
    near = abs(bearing) <= engage_bound(measurement, settings)
    return state.latched or near or bearing * state.side < 0.0
