"""Way: what commands make of travel, distance, range and rates between two images."""

import math

from visual_servo_epipolar.core.laws import equations
from visual_servo_epipolar.core.laws.timing import usual_step
from visual_servo_epipolar.core.perception.measurement import Measurement
from visual_servo_epipolar.core.servo.identification.ranging import Leg, MIN_TURN
from visual_servo_epipolar.core.servo.settings import ServoSettings
from visual_servo_epipolar.core.servo.state import ServoState

RATE_SMOOTHING = 0.4  # weight of the newest value in an exponential mean, as the next two
RANGE_SMOOTHING = 0.2
PERIOD_SMOOTHING = 0.1
MIN_SPEED = 0.05  # below which the path says nothing about the range [m/s]
TURN_DEVIATIONS = 8.0  # least turn of the line of sight, in deviations of a bearing


def driven(state: ServoState, dt: float, settings: ServoSettings) -> float:
    """Return the travel between the last two images [m], of commands that act late."""
    if dt == 0.0:
        return 0.0
    late = min(settings.latency / dt, 1.0)
    return (state.twist.linear + late * (state.motion.last_linear - state.twist.linear)) * dt


def backward(state: ServoState, dt: float) -> float:
    """
    Return the largest travel backward between the last two images [m].

    It is a bound that counts: a command acts late, and may have been withdrawn in between.
    """
    fastest = max(-state.twist.linear, -state.motion.last_linear, 0.0)
    return fastest * (dt or usual_step(state))


def distance(state: ServoState, dt: float, settings: ServoSettings) -> float:
    """Return d_hat [m], integrated over ``dt`` [s] by the applied speed (18)."""
    if math.isnan(state.motion.distance):
        return max(settings.initial_distance, settings.min_distance)
    previous = state.measurement
    if previous is None or previous.bearings is None:
        return state.motion.distance
    # sigma of the geometry itself, also under the printed law: this is kinematics.
    rate = equations.distance_rate(
        state.twist.linear, previous.bearings.epipole_current, sigma=previous.bearings.sigma
    )
    return max(state.motion.distance + rate * dt, settings.min_distance)


def period(state: ServoState, dt: float) -> float:
    """Return the time between two images [s], smoothed."""
    if math.isnan(state.view.period):
        return dt or math.nan
    if dt == 0.0:  # stamps that leap tell nothing of it
        return state.view.period
    return state.view.period + PERIOD_SMOOTHING * (dt - state.view.period)


def leg(state: ServoState, dt: float) -> Leg | None:
    """Return the leg extended by the last command for ``dt`` [s]."""
    if state.motion.leg is None or state.measurement is None or state.measurement.bearings is None:
        return state.motion.leg
    return state.motion.leg.extended(state.measurement.bearings, state.twist.linear * dt)


def ranged(state: ServoState, measurement: Measurement, leg: Leg | None, dt: float) -> float:
    """Return the distance to the goal [m]: predicted by the command, corrected by the ``leg``."""
    previous, predicted = state.measurement, state.motion.range
    if previous is not None and previous.bearings is not None:
        predicted += state.twist.linear * math.cos(previous.bearings.phi) * dt
    measured = measured_range(state, measurement, leg)
    if measured is None:
        return predicted if math.isnan(predicted) else max(predicted, 0.0)
    if math.isnan(predicted):
        return measured
    return predicted + RANGE_SMOOTHING * (measured - predicted)


def measured_range(state: ServoState, measurement: Measurement, leg: Leg | None) -> float | None:
    """Return the distance that the ``leg`` shows [m]; None outside step 1, or at a standstill."""
    if leg is None or measurement.bearings is None or not state.phase.ranges:
        return None
    if abs(state.twist.linear) < MIN_SPEED:  # noise alone would move the estimate
        return None
    deviation = 0.0 if math.isnan(measurement.deviation) else measurement.deviation
    min_turn = max(MIN_TURN, TURN_DEVIATIONS * deviation)
    return leg.distance(measurement.bearings.psi, min_turn=min_turn)


def desired_rate(state: ServoState, measurement: Measurement, dt: float) -> float:
    """Return the rate of the bearing of e_du [rad/s], smoothed; 0 where it is unknown."""
    previous = state.measurement
    if previous is None or previous.bearings is None or measurement.bearings is None or dt == 0.0:
        return 0.0
    rate = (measurement.bearings.chi - previous.bearings.chi) / dt
    return state.law.desired_rate + RATE_SMOOTHING * (rate - state.law.desired_rate)
