"""Command: the twist for the base, and the angles for a head where the rig has one."""

from dataclasses import dataclass

from visual_servo_epipolar.core.geometry.motion import STANDSTILL, Twist
from visual_servo_epipolar.core.rigs.rig import HeadCommand


@dataclass(frozen=True, slots=True)
class Command:
    """
    Command of one control step: the ``twist`` of the base [m/s, rad/s], and that to a ``head``.

    A base and the publisher of the servo take it whole, so that every field reaches both. None is
    that of a rig without a head, and leaves any other as it is.
    """

    twist: Twist = STANDSTILL
    head: HeadCommand | None = None


HALT = Command()
