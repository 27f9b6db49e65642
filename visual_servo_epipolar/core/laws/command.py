"""Command: what the servo asks of the base; a pan head or a steering angle would join it here."""

from dataclasses import dataclass

from visual_servo_epipolar.core.geometry.motion import STANDSTILL, Twist


@dataclass(frozen=True, slots=True)
class Command:
    """
    Command of one control step: the ``twist`` of the base [m/s, rad/s].

    A base and the publisher of the servo take it whole, so that a new field reaches both.
    """

    twist: Twist = STANDSTILL


HALT = Command()
