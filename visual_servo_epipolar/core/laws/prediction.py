"""
Prediction: laws go by where the robot will be when it obeys, where it obeys late.

What was commanded and has not acted yet is driven ahead from where the robot is seen (Smith 1957;
Artstein 1982). The loop is then as without the delay, but for what the base does otherwise.
Events go by what is seen, and a robot that has settled must be there when all has acted, too.
"""

from dataclasses import replace
import math

from visual_servo_epipolar.core.estimate.base_model import BORNE
from visual_servo_epipolar.core.estimate.goal_estimate import GoalEstimate
from visual_servo_epipolar.core.estimate.settings import DriveSettings
from visual_servo_epipolar.core.geometry.epipolar import Bearings
from visual_servo_epipolar.core.laws.phase import Phase
from visual_servo_epipolar.core.stamps import NANOSECONDS


def predicted(goal: GoalEstimate, phase: Phase, settings: DriveSettings) -> GoalEstimate:
    """Return ``goal`` as it will be in a ``phase`` when the next command acts."""
    if not phase.drives or not is_late(settings):
        return goal
    now_ns = goal.stamp_ns
    late_ns = round(settings.latency * NANOSECONDS)
    turn, right, ahead = 0.0, 0.0, 0.0
    for span, twist in goal.motion.sent.acting(now_ns, now_ns + late_ns, settings.latency):
        heading = goal.heading_error + turn + 0.5 * twist.angular * span
        right -= twist.linear * span * math.sin(heading)
        ahead += twist.linear * span * math.cos(heading)
        turn += twist.angular * span
    return _moved(goal, (right, ahead), turn)


def _moved(goal: GoalEstimate, way: tuple[float, float], turn: float) -> GoalEstimate:
    """Return ``goal`` after a ``way``, right and ahead [m], and a ``turn`` [rad]."""
    heading = math.remainder(goal.heading_error + turn, 2.0 * math.pi)
    left, right = goal.view_margins
    slope = goal.difference_slope
    slope = slope if slope > 0.0 else goal.motion.slope.value
    rise = slope * way[1] if slope > 0.0 else 0.0
    moved = replace(
        goal,
        heading_error=heading,
        rotation_heading=math.remainder(goal.rotation_heading + turn, 2.0 * math.pi),
        difference=goal.difference + rise,
        view_margins=(max(left - turn, 0.0), max(right + turn, 0.0)),
    )
    if goal.offset is not None:
        offset = goal.offset[0] + way[0], goal.offset[1] + way[1]
        moved = replace(moved, offset=offset)
    if goal.bearings is None:
        return moved
    psi, distance = goal.bearings.psi, goal.distance()
    x, y = distance * math.cos(psi) + way[0], distance * math.sin(psi) + way[1]
    psi = math.atan2(y, x)
    phi = math.remainder(psi - heading - 0.5 * math.pi, 2.0 * math.pi)
    return replace(moved, bearings=Bearings(psi, phi))


def is_late(settings: DriveSettings) -> bool:
    """Return whether the base obeys so late that laws must look ahead."""
    return settings.options.anticipation and settings.latency > BORNE


def felt_latency(settings: DriveSettings) -> float:
    """Return the delay that laws still feel [s]: none is longer than they bear."""
    return min(settings.latency, BORNE) if is_late(settings) else settings.latency
