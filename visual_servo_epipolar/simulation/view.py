"""View: the protocol of every source of features in a closed loop."""

from typing import Protocol

from visual_servo_epipolar.core.geometry.motion import Pose, Twist
from visual_servo_epipolar.core.rigs.rig import Joints
from visual_servo_epipolar.core.tracking.features import Features
from visual_servo_epipolar.simulation.nod import LEVEL, Nod


class View(Protocol):
    """What stands between the world and the servo: points, or images and a tracker."""

    def observe(self, pose: Pose, frame: int) -> Features:
        """Return the features visible from ``pose`` in frame number ``frame``: 0, 1, ..."""

    def turn(self, joints: Joints) -> None:
        """Let the head that carries the camera have its joints at these angles from now on."""
        raise ValueError(f'{type(self).__name__} has no head to turn; simulate a fixed rig')

    def move(self, twist: Twist, nod: Nod = LEVEL) -> None:
        """Let base and body move so while images are exposed; an instant shows the pitch alone."""
