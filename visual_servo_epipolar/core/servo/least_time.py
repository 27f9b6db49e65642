"""Least time: how soon a base could be at the goal, by its limits alone."""

from dataclasses import dataclass
import math

from visual_servo_epipolar.core.geometry.motion import Pose
from visual_servo_epipolar.core.laws.settings import ControlSettings

BESIDE = (
    0.65  # bearing off the goal's axis from which no way straight ahead keeps it in view [rad]
)
MOST_TURNED = 0.5  # heading error with which a robot beside the goal moves aside at most [rad]


@dataclass(frozen=True, slots=True)
class MotionLimits:
    """Limits of the base: speeds ahead and back [m/s], speeding up and slowing down [m/s^2]."""

    speed: float
    backward: float
    acceleration: float
    deceleration: float

    @classmethod
    def of(cls, settings: ControlSettings, *, backward: float) -> 'MotionLimits':
        """Return the limits that the servo keeps, with its speed ``backward`` [m/s]."""
        speed, faster = settings.max_linear * settings.max_speed_ratio, settings.max_acceleration
        return cls(speed, min(backward, speed), faster, 2.0 * faster)

    def time(self, way: float, speed: float) -> float:
        """Return the least time of a straight ``way`` [m] from standstill to standstill [s]."""
        ramps = 1.0 / self.acceleration + 1.0 / self.deceleration
        if way < 0.5 * speed * speed * ramps:
            return math.sqrt(2.0 * way * ramps)
        return way / speed + 0.5 * speed * ramps


def least_time(start: Pose, limits: MotionLimits) -> float:
    """
    Return T_0, the least time from ``start`` to the goal within ``limits`` [s].

    From behind the goal it is that of the straight way, d_0 / v + v/2 (1/a + 1/b). From more than
    BESIDE off the goal's axis features would leave the view on it: the least way is one back and
    one ahead, both as far aside as a heading error of MOST_TURNED leads.
    """
    behind, aside = -start.y, abs(start.x)
    if aside <= behind * math.tan(BESIDE):
        return limits.time(start.distance, limits.speed)
    ahead = behind / math.cos(MOST_TURNED)
    way = max(aside / math.sin(MOST_TURNED), abs(ahead))
    back = 0.5 * (way - ahead)
    return limits.time(back, limits.backward) + limits.time(way - back, limits.speed)
