"""A simulated car: its axle is steered to what a twist asks for, at a limited rate."""

from collections.abc import Mapping
from dataclasses import dataclass
import math
from typing import Any, ClassVar

from visual_servo_epipolar.core.geometry.motion import Pose, Twist
from visual_servo_epipolar.core.settings import setting
from visual_servo_epipolar.simulation.bases.pioneer import obeyed, Pioneer, PioneerSettings


@dataclass(frozen=True, kw_only=True)
class AckermannSettings(PioneerSettings):
    """A car on the wheels of the Pioneer: what steers it; no wheel ratio, no turns of its own."""

    wheelbase: float = setting(0.33, 'Car: distance between both axles [m]', low=0.02, high=10.0)
    max_steering: float = setting(
        0.503, 'Car: largest angle of the steered wheels [rad]', low=0.01, high=1.5
    )
    steering_rate: float = setting(
        1.0, 'Car: how fast they are steered [rad/s]', low=0.01, high=50.0
    )
    GONE: ClassVar[Mapping[str, Any]] = {'steering_offset': 0.0}


class Ackermann(Pioneer):
    """
    The base, as ``Pioneer``, but for its steering: the axle between the rear wheels is the robot.

    A twist steers by atan(wheelbase w / v), as drivers of such bases do: w without v steers as far
    as the wheels go and moves nothing, and a zero twist steers straight.
    """

    settings: AckermannSettings

    def __init__(
        self, settings: AckermannSettings, pose: Pose, *, seed: int, now_ns: int = 0
    ) -> None:
        super().__init__(settings, pose, seed=seed, now_ns=now_ns)
        self.steering = 0.0  # [rad], to the left

    def _limited(self, twist: Twist) -> tuple[float, float]:
        """Return the speed [m/s] and the steering angle [rad] that ``twist`` asks for."""
        limits = self.settings
        speed = min(max(twist.linear, -limits.max_linear), limits.max_linear)
        speed = obeyed(speed, limits.dead_zone_linear, limits.step_linear)
        angle = 0.0
        if twist.linear:
            angle = math.atan(limits.wheelbase * twist.angular / twist.linear)
        elif twist.angular:
            angle = math.copysign(math.inf, twist.angular)
        return speed, min(max(angle, -limits.max_steering), limits.max_steering)

    def _accelerated(self, aim: float, turn: float, dt: float) -> tuple[float, float]:
        change = self.settings.steering_rate * dt
        self.steering += min(max(turn - self.steering, -change), change)
        speed = self._faster(aim, self._wheels[0], dt)
        wheels = speed, speed * math.tan(self.steering) / self.settings.wheelbase
        return self._wheels if wheels == self._wheels else wheels

    def _true(self, linear: float, angular: float) -> tuple[float, float]:
        settings = self.settings
        if linear == 0.0:
            return 0.0, 0.0
        grip = 1.0 - settings.slip
        angle = math.atan(settings.wheelbase * angular / linear)
        return grip * linear, grip * linear * math.tan(angle) / settings.wheelbase
