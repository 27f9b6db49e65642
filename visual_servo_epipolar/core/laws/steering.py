"""
Steering in egocentric polar coordinates, which the two oriented bearings are (no step, no pose).

``delta`` is the robot's heading against the line of sight to the goal, ``phi`` the goal's heading
against it, both left positive [rad]: delta = ``Bearings.current``, and phi = delta - alpha, alpha
being the heading error. For a unicycle at the distance d, with the curvature kappa of its path,

    d' = -v cos(delta)      phi' = v sin(delta) / d      delta' = v (kappa + sin(delta) / d)

The curvature law (Park and Kuipers, ICRA 2011) turns delta to its aim atan(-k_1 phi), along which
phi decays. It needs the distance as the scale of curvature alone, and no epipole that may be
infinite. Angles in rad, lengths in m, velocities in m/s and rad/s.

A camera that sees all round leads its robot around the goal. A head that turns its camera, or a
lens that sees half a circle, keeps features in view within a window of headings: where the aim of
delta is beyond it, the robot drives straight on at the window's edge, the distance falls, and
with it |phi|, until the aim is within: delta goes from low + phi to aim(phi), and what is left of
the distance is the ratio of their sines. Where that is too little, or nothing, it backs off, by
the same law driven backward, for which the goal's other side is ahead.
"""

from __future__ import annotations

import math
from typing import NamedTuple

from visual_servo_epipolar.core.bases.base import turns_in_place
from visual_servo_epipolar.core.estimate.goal_estimate import GoalEstimate
from visual_servo_epipolar.core.estimate.settings import DriveSettings
from visual_servo_epipolar.core.geometry.motion import wrap_angle
from visual_servo_epipolar.core.laws.braking import NEAR

LINE = 0.7  # heading error [rad] and slope from behind within which, NEAR, a line is followed
AT_GOAL_AROUND = 0.12  # nearer no direction to it is worth a turn [m]
BEHIND_IT = 2.6  # |phi| beyond which either side leads around as well [rad]
STEERED, TURNS_IN_PLACE = 0.6, 1.0  # off the aim: up to which it drives on, and not at all [rad]
NEARS, LEADS_AWAY = 1.45, 1.6  # delta at which it drives on, and not at all [rad]
RESERVE = 0.05  # of the margins of the view [rad]
WIDE_RESERVE = 0.3  # of those by which the way is chosen [rad]
LEAST_SHARE, KEPT_SHARE = 0.35, 0.2  # of the distance left where the aim is seen: at first, later
AT_GOAL = 0.25  # nearer a bearing tells of the goal, not of the way: it follows the line to it [m]
STEPS = 12  # of Newton's method; one is exact to a degree


class PolarPose(NamedTuple):
    """Pose of the robot as seen from itself: ``distance`` [m], ``delta`` and ``phi`` [rad]."""

    distance: float
    delta: float
    phi: float


class Gains(NamedTuple):
    """Gains of the curvature law: k_1 of the aim of delta, k_2 of the turn to it."""

    k1: float = 2.0
    k2: float = 4.0

    @property
    def look_aheads(self) -> float:
        """Distance over the look-ahead L of the line following that the law is near its axis."""
        # kappa = x / L^2 - (1 + k1 + k2) heading / d there, with L = d / sqrt((1 + k1) (1 + k2)).
        return math.sqrt((1.0 + self.k1) * (1.0 + self.k2))


GAINS = Gains()


def polar_pose(x: float, y: float, heading_error: float, *, ahead: float = 0.0) -> PolarPose:
    """
    Return the pose against a goal that is ``ahead`` [m] of the true one, on its axis.

    ``x``, ``y`` are right and ahead of the true goal [m]. A goal ahead keeps the angles defined
    where the robot is at the true one.
    """
    sight = math.atan2(ahead - y, -x)  # direction of the line of sight, from +x
    distance = math.hypot(x, ahead - y)
    phi = wrap_angle(0.5 * math.pi - sight)
    return PolarPose(distance, wrap_angle(heading_error + phi), phi)


def aim(phi: float, gains: Gains = GAINS) -> float:
    """Return the delta on which phi decays: atan(-k_1 phi) [rad]."""
    return math.atan(-gains.k1 * phi)


def curvature(pose: PolarPose, gains: Gains = GAINS, *, delta_held: float | None = None) -> float:
    """
    Return kappa = -(1/d) [k_2 (delta - aim) + (1 + k_1 / (1 + (k_1 phi)^2)) sin(delta)] [1/m].

    Where the field of view does not allow the aim, ``delta_held`` is as near to it as features
    stay in view: the robot turns to that heading, and drives straight.
    """
    if delta_held is not None:
        turn = min(max(pose.delta - delta_held, -math.pi), math.pi)
        return -gains.k2 * turn / pose.distance
    turn = gains.k2 * wrap_angle(pose.delta - aim(pose.phi, gains))
    rate = gains.k1 / (1.0 + (gains.k1 * pose.phi) ** 2)
    return -(turn + (1.0 + rate) * math.sin(pose.delta)) / pose.distance


def visible_aim(wanted: float, delta: float, margins: tuple[float, float]) -> float | None:
    """
    Return the aim of delta nearest to ``wanted`` that keeps features in view; None if it does.

    ``margins`` are how far the robot may turn left and right, less what is kept in reserve; a
    negative one asks for a turn back.
    """
    left, right = margins
    if left + right <= 0.0:
        return delta + 0.5 * (left - right)
    if left + right > math.pi:  # where the short way leads out of view, the long one may not
        nearest = (wanted, wanted - math.tau, wanted + math.tau)
        turns = sorted(nearest, key=lambda each: abs(each - delta))
        wanted = min(turns, key=lambda each: max(delta - right - each, each - delta - left, 0.0))
    visible = min(max(wanted, delta - right), delta + left)
    return None if visible == wanted and abs(visible - delta) <= math.pi else visible


def sees_all_round(goal: GoalEstimate) -> bool:
    """Return whether no turn leads features out of view."""
    return math.isinf(min(goal.view_margins))


def goes_around(x: float, y: float, heading: float, goal: GoalEstimate) -> bool:
    """Return whether one at ``x``, ``y`` [m] goes around the goal, not up a line to it."""
    distance = math.hypot(x, y)
    if not sees_all_round(goal) or distance < AT_GOAL_AROUND:
        return False
    return distance > NEAR or abs(heading) > LINE or abs(x) > -LINE * y


def on_nearer_side(pose: PolarPose) -> PolarPose:
    """Return ``pose`` with the phi, of the two ahead of the goal, whose aim is the nearer one."""
    if abs(pose.phi) <= BEHIND_IT:
        return pose
    other = pose._replace(phi=pose.phi - math.copysign(math.tau, pose.phi))
    return min(pose, other, key=lambda each: abs(off_aim(each)))


def off_aim(pose: PolarPose) -> float:
    """Return by how much delta is off its aim [rad]."""
    return wrap_angle(pose.delta - aim(pose.phi))


def driving_share(delta: float, off: float, *, in_place: float = TURNS_IN_PLACE) -> float:
    """
    Return the share of the speed, by how far delta is ``off`` its aim, and leads away [rad].

    Off by ``in_place`` and more the robot does not drive at all: it has to turn in place.
    """
    steered = min(max((in_place - abs(off)) / (in_place - STEERED), 0.0), 1.0)
    nearing = min(max((LEADS_AWAY - abs(delta)) / (LEADS_AWAY - NEARS), 0.0), 1.0)
    return min(steered, nearing)


def heading_window(goal: GoalEstimate, reserve: float) -> tuple[float, float]:
    """Return the least and the largest heading error at which features are in view [rad]."""
    left, right = goal.view_margins
    if math.isinf(left + right):
        return -math.inf, math.inf
    # About the photograph's heading, whatever features are tracked from here: of a fixed lens
    # these are others from another heading, and a window that moves along leads back and forth.
    half = 0.5 * (left + right) - reserve
    return -half, half


def share_left(phi: float, window: tuple[float, float]) -> float:
    """Return the share of the distance that is left where the aim of delta is within a window."""
    edge = -window[0] if phi > 0.0 else window[1]  # by symmetry of one to the right
    phi = abs(phi)
    if phi - aim(phi) <= edge:
        return 1.0
    if phi >= edge:
        return 0.0  # it leads past the goal
    within = 0.5 * edge
    for _ in range(STEPS):
        slope = 1.0 + GAINS.k1 / (1.0 + (GAINS.k1 * within) ** 2)
        within -= (within - aim(within) - edge) / slope
    return math.sin(edge - phi) / math.sin(edge - within)


def leads_around(
    pose: PolarPose,
    goal: GoalEstimate,
    settings: DriveSettings,
    *,
    least: float = LEAST_SHARE,
) -> bool:
    """
    Return whether one motion leads from ``pose`` around to the goal, in view all the way.

    A base that steers cannot turn to the aim first: ``on_arcs`` says where its motion leads. A
    view is wide where the robot may be so far off its aim that it turns in place.
    """
    low, high = heading_window(goal, WIDE_RESERVE)
    wide = low < -TURNS_IN_PLACE and high > TURNS_IN_PLACE and math.isfinite(high - low)
    leads = turns_in_place(settings.drive) and wide
    return leads and share_left(pose.phi, (low, high)) >= least


def goes_around_in_view(
    pose: PolarPose,
    goal: GoalEstimate,
    settings: DriveSettings,
    *,
    least: float = KEPT_SHARE,
    aside: float = STEERED,
) -> bool:
    """Return whether it goes around the goal now: it is ``aside`` [rad] of the way ahead."""
    if pose.distance < AT_GOAL or max(abs(pose.phi), abs(pose.delta)) < aside:
        return False
    return leads_around(pose, goal, settings, least=least)
