"""View: what every source of features in a closed loop takes and gives."""

from typing import Protocol

from visual_servo_epipolar.core.geometry.motion import Pose
from visual_servo_epipolar.core.tracking.features import Features


class View(Protocol):
    """What stands between the world and the servo: points, or images and a tracker."""

    def observe(self, pose: Pose, frame: int) -> Features:
        """Return the features visible from ``pose`` in frame number ``frame``: 0, 1, ..."""
        ...
