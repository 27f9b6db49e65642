"""
All-round views: with a camera that sees all around, one motion leads home from every pose.

Nothing leaves the view, so no robot backs off: from beside or ahead of the goal the curvature law
drives around it, with delta at most atan(k_1 pi), 81 deg, and the distance falls all the way. One
that is turned far from the aim of delta turns in place first, for it would drive away meanwhile.
"""

from __future__ import annotations

import math

from visual_servo_epipolar.core.geometry.motion import wrap_angle
from visual_servo_epipolar.core.laws.smooth.steering import aim, PolarPose
from visual_servo_epipolar.core.perception.measurement import Measurement

NEAR, TURNED = 0.35, 0.7  # [m], [rad]: within both the line to the goal is followed,
LINE_SLOPE = 0.7  # by who is behind it and no farther aside than that share
AT_GOAL = 0.12  # nearer no direction to it is worth a turn [m]
BEHIND_IT = 2.6  # |phi| beyond which either side leads around as well [rad]
STEERED, IN_PLACE = 0.6, 1.0  # off the aim: up to which it drives on, and not at all [rad]
NEARS, LEADS_AWAY = 1.45, 1.6  # delta at which it drives on, and not at all [rad]
LEAST_WAY = 0.5  # of the distance, that is left to drive at least while it goes around


def sees_all_round(measurement: Measurement) -> bool:
    """Return whether no turn leads features out of view."""
    return math.isinf(min(measurement.view_margins))


def goes_around(x: float, y: float, heading: float, measurement: Measurement) -> bool:
    """Return whether one at ``x``, ``y`` [m] goes around the goal, not up a line to it."""
    distance = math.hypot(x, y)
    if not sees_all_round(measurement) or distance < AT_GOAL:
        return False
    return distance > NEAR or abs(heading) > TURNED or abs(x) > -LINE_SLOPE * y


def line_share(x: float, y: float) -> float:
    """Return the share of the look-ahead that is aimed at ahead of the goal: by who is behind."""
    return min(max(2.0 * (1.0 + abs(x) / y), 0.0), 1.0) if y < 0.0 else 0.0


def on_nearer_side(pose: PolarPose) -> PolarPose:
    """Return ``pose`` with the phi, of the two ahead of the goal, whose aim is the nearer one."""
    if abs(pose.phi) <= BEHIND_IT:
        return pose
    other = pose._replace(phi=pose.phi - math.copysign(math.tau, pose.phi))
    return min(pose, other, key=lambda each: abs(off_aim(each)))


def off_aim(pose: PolarPose) -> float:
    """Return by how much delta is off its aim [rad]."""
    return wrap_angle(pose.delta - aim(pose.phi))


def driving_share(delta: float, off: float, *, in_place: float = IN_PLACE) -> float:
    """
    Return the share of the speed, by how far delta is ``off`` its aim, and leads away [rad].

    Off by ``in_place`` and more the robot does not drive at all: it has to turn in place.
    """
    steered = min(max((in_place - abs(off)) / (in_place - STEERED), 0.0), 1.0)
    nearing = min(max((LEADS_AWAY - abs(delta)) / (LEADS_AWAY - NEARS), 0.0), 1.0)
    return min(steered, nearing)
