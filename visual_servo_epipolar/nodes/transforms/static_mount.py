"""The mount of the camera out of /tf_static, where robots say how their parts are fixed."""

from typing import Any

import numpy as np
from rclpy.node import Node

from visual_servo_epipolar.core.arrays import FloatArray
from visual_servo_epipolar.core.geometry.mount import Mount, mount_of
from visual_servo_epipolar.messages import read, transforms
from visual_servo_epipolar.nodes import qos

Transform = tuple[FloatArray, FloatArray]
DEEPEST = 100  # frames between a camera and its base: more are a circle


class StaticMount:
    """
    Keeps the static transforms of a robot, and knows from them how its camera is mounted.

    Without tf2_msgs it says so, and nothing is known.
    """

    def __init__(self, node: Node, base_frame: str) -> None:
        self._base, self._log = base_frame, node.get_logger()
        self._parents: dict[str, tuple[str, Transform]] = {}
        kind = transforms.tf_message_class()
        if kind is None:
            self._log.warning(transforms.without_tf2_msgs('mount_from_tf has no effect'))
        else:
            node.create_subscription(kind, '/tf_static', self.receive, qos.STATIC_TRANSFORMS)

    def receive(self, message: Any) -> None:
        """Take in a tf2_msgs/TFMessage; a transform that cannot be used is left out and said."""
        for item in message.transforms:
            try:
                self._parents[item.child_frame_id] = item.header.frame_id, read.transform(item)
            except ValueError as error:
                self._log.warning(f'/tf_static: {error}', throttle_duration_sec=5.0)

    def of(self, camera_frame: str) -> Mount | None:
        """
        Return how the camera of ``camera_frame`` is mounted, or None where nobody says.

        Raises
        ------
        ValueError
            If what is said is no mount of a camera.

        """
        frame, rotation, origin = camera_frame, np.eye(3), np.zeros(3)
        for _ in range(DEEPEST):
            if frame == self._base:
                return None if frame == camera_frame else mount_of(rotation, origin)
            if frame not in self._parents:
                return None
            frame, (turn, place) = self._parents[frame]
            rotation, origin = turn @ rotation, turn @ origin + place
        return None
