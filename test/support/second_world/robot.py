"""A robot of another make: two lagging wheels, a dead time, the right wheel larger than told."""

from collections import deque
from dataclasses import dataclass, field
import math

import numpy as np

from visual_servo_epipolar.core.geometry.motion import Pose, STANDSTILL, Twist

STEP = 0.005  # of the integration [s]
TRACK = 0.42  # between the wheels [m]
LAG = 0.12  # time constant of a wheel [s]
DEAD_TIME = 0.09  # from a command to the motors [s]
RIGHT_WHEEL = 1.01  # of the radius that the motors believe in


@dataclass
class Robot:
    """Obeys commands as late and as crookedly as its motors do; Heun's method, step by step."""

    pose: Pose
    wheels: np.ndarray = field(default_factory=lambda: np.zeros(2))  # left and right [m/s]
    late: deque[Twist] = field(
        default_factory=lambda: deque([STANDSTILL] * round(DEAD_TIME / STEP))
    )

    def drive(self, command: Twist, seconds: float) -> None:
        """Obey a command for so long."""
        for _ in range(round(seconds / STEP)):
            self.late.append(command)
            wanted = self.late.popleft()
            aside = 0.5 * TRACK * wanted.angular
            goal = np.array([wanted.linear - aside, wanted.linear + aside])
            self.wheels = self.wheels + STEP / LAG * (goal - self.wheels)
            self._move(float(self.wheels[0]), RIGHT_WHEEL * float(self.wheels[1]))

    def _move(self, left: float, right: float) -> None:
        pose, speed = self.pose, 0.5 * (left + right)
        turned = pose.theta + STEP * (right - left) / TRACK
        x = pose.x + 0.5 * STEP * speed * (math.cos(pose.theta) + math.cos(turned))
        y = pose.y + 0.5 * STEP * speed * (math.sin(pose.theta) + math.sin(turned))
        self.pose = Pose(x, y, turned)
