"""What the servo commands: today a twist; a pan head or a steering angle would join it here."""

from dataclasses import dataclass

from visual_servo_epipolar.core.geometry.motion import STANDSTILL, Twist


@dataclass(frozen=True, slots=True)
class Command:
    """One command to the robot: the ``twist`` of its base."""

    twist: Twist = STANDSTILL


HALT = Command()
