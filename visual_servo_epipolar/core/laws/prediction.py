"""
Prediction: laws go by where the robot will be when it obeys, where it obeys late.

What was commanded and has not acted yet is driven ahead from where the robot is seen (Smith 1957;
Artstein 1982): the loop is then as without the delay, but for what the base does otherwise. Events
go by what is seen, and who has settled must be there when all has acted, too.
"""

from dataclasses import replace
import math

from visual_servo_epipolar.core.estimate.delay import BORNE
from visual_servo_epipolar.core.estimate.settings import DriveSettings
from visual_servo_epipolar.core.geometry.epipolar import Bearings
from visual_servo_epipolar.core.laws.state import ServoState
from visual_servo_epipolar.core.perception.measurement import Measurement
from visual_servo_epipolar.core.stamps import NANOSECONDS


def predicted(state: ServoState, settings: DriveSettings) -> ServoState:
    """Return ``state`` with its measurement as it will be when the next command acts."""
    measurement = state.measurement
    if measurement is None or not state.phase.drives or not is_late(settings):
        return state
    now_ns = measurement.stamp_ns
    late_ns = round(settings.latency * NANOSECONDS)
    turn, right, ahead = 0.0, 0.0, 0.0
    for span, twist in state.motion.sent.acting(now_ns, now_ns + late_ns, settings.latency):
        heading = measurement.heading_error + turn + 0.5 * twist.angular * span
        right -= twist.linear * span * math.sin(heading)
        ahead += twist.linear * span * math.cos(heading)
        turn += twist.angular * span
    return state.changed(measurement=_moved(measurement, state, (right, ahead), turn))


def _moved(
    measurement: Measurement, state: ServoState, way: tuple[float, float], turn: float
) -> Measurement:
    """Return ``measurement`` after a ``way``, right and ahead [m], and a ``turn`` [rad]."""
    heading = math.remainder(measurement.heading_error + turn, 2.0 * math.pi)
    left, right = measurement.view_margins
    slope = measurement.difference_slope
    slope = slope if slope > 0.0 else state.motion.slope.value
    rise = slope * way[1] if slope > 0.0 else 0.0
    moved = replace(
        measurement,
        heading_error=heading,
        rotation_heading=math.remainder(measurement.rotation_heading + turn, 2.0 * math.pi),
        difference=measurement.difference + rise,
        view_margins=(max(left - turn, 0.0), max(right + turn, 0.0)),
    )
    if measurement.offset is not None:
        offset = measurement.offset[0] + way[0], measurement.offset[1] + way[1]
        moved = replace(moved, offset=offset)
    if measurement.bearings is None:
        return moved
    psi, distance = measurement.bearings.psi, goal_distance(state, measurement)
    x, y = distance * math.cos(psi) + way[0], distance * math.sin(psi) + way[1]
    psi = math.atan2(y, x)
    phi = math.remainder(psi - heading - 0.5 * math.pi, 2.0 * math.pi)
    return replace(moved, bearings=Bearings(psi, phi))


def goal_distance(state: ServoState, measurement: Measurement) -> float:
    """Return the distance from the goal, as well as it is known [m]."""
    if measurement.offset is not None:
        return math.hypot(*measurement.offset)
    if state.identified.extrinsics is not None and state.identified.extrinsics.is_ranged:
        return state.identified.extrinsics.distance
    return state.motion.range if state.motion.range > 0.0 else state.motion.distance


def is_late(settings: DriveSettings) -> bool:
    """Return whether the base obeys so late that laws must look ahead."""
    return settings.options.anticipation and settings.latency > BORNE


def felt_latency(settings: DriveSettings) -> float:
    """Return the delay that laws still feel [s]: none is longer than they bear."""
    return min(settings.latency, BORNE) if is_late(settings) else settings.latency
