"""
Position-based: the polar law of Aicardi, Casalino, Bicchi, Balestrino (1995) on the relative pose.

With e the distance, a the direction of the goal against the heading and b against the goal's
heading, u = g cos(a) e and w = k a + g cos(a) sin(a) / a (a + h b) make (e^2 + a^2 + h b^2) / 2
fall. It is smooth, and knows no field of view. Close to the goal, where the direction of the
residual is noise, the robot covers the way ahead and turns to the final heading.
"""

from dataclasses import dataclass
import math

from visual_servo_epipolar.core.geometry.motion import Twist, wrap_angle
from visual_servo_epipolar.core.settings import setting, Settings
from visual_servo_epipolar.evaluation.benchmarks.laws.pose_measurement import RelativePose


@dataclass(frozen=True, kw_only=True)
class PolarGains(Settings):
    """Gains of the polar law, and the depth that it takes for the scene's."""

    depth: float = setting(5.0, 'Depth Z of the scene from the goal [m]', low=0.1, high=100.0)
    close: float = setting(0.05, 'Distance at which directions are noise [m]', low=0.0, high=1.0)
    approach: float = setting(0.3, 'Gain g of the distance [1/s]', low=0.01, high=5.0)
    turn: float = setting(1.0, 'Gain k of the direction [1/s]', low=0.01, high=5.0)
    align: float = setting(1.5, 'Weight h of the final heading', low=0.01, high=20.0)


def polar(pose: RelativePose, gains: PolarGains, *, backwards: bool = False) -> Twist:
    """Return the twist of the polar law; ``backwards`` drives it with the robot's other end."""
    if pose.distance * gains.depth < gains.close:
        ahead = gains.approach * pose.ahead * gains.depth
        return Twist(ahead, -gains.turn * pose.heading_error)
    half_turn = math.pi if backwards else 0.0
    toward = pose.psi + math.pi - half_turn  # the direction in which that end has to go
    against_goal = wrap_angle(toward - 0.5 * math.pi)
    against_heading = wrap_angle(against_goal - pose.heading_error)
    cosine = math.cos(against_heading)
    sinc = math.sin(against_heading) / against_heading if against_heading else 1.0
    pull = gains.approach * cosine * sinc * (against_heading + gains.align * against_goal)
    speed = gains.approach * cosine * pose.distance * gains.depth
    return Twist(-speed if backwards else speed, gains.turn * against_heading + pull)


def is_behind(pose: RelativePose) -> bool:
    """Return whether the goal lies behind the robot, so that it is to be reached backwards."""
    return pose.ahead < 0.0
