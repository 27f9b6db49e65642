"""
Steering in egocentric polar coordinates, which the two oriented bearings are (no step, no pose).

``delta`` is the robot's heading against the line of sight to the goal, ``phi`` the goal's heading
against it, both left positive [rad]: delta = ``Bearings.current``, and phi = delta - alpha, alpha
being the heading error. For a unicycle at the distance d, with the curvature kappa of its path,

    d' = -v cos(delta)      phi' = v sin(delta) / d      delta' = v (kappa + sin(delta) / d)

The curvature law (Park and Kuipers, ICRA 2011) turns delta to its aim atan(-k_1 phi), along which
phi decays. It needs the distance as the scale of curvature alone, and no epipole that may be
infinite. Angles in rad, lengths in m, velocities in m/s and rad/s.
"""

import math
from typing import NamedTuple

from visual_servo_epipolar.core.geometry.motion import wrap_angle

TURN = 2.0 * math.pi


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
        turns = sorted((wanted, wanted - TURN, wanted + TURN), key=lambda each: abs(each - delta))
        wanted = min(turns, key=lambda each: max(delta - right - each, each - delta - left, 0.0))
    visible = min(max(wanted, delta - right), delta + left)
    return None if visible == wanted and abs(visible - delta) <= math.pi else visible
