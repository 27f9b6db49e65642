"""Frames over ROS: /tf of the simulated robot, and the mount of the camera from /tf_static."""

from collections.abc import Callable, Sequence
from typing import Any

from geometry_msgs.msg import TransformStamped
import numpy as np
from rclpy.node import Node

from visual_servo_epipolar.core.arrays import FloatArray
from visual_servo_epipolar.core.rigs.fixed_mount import (
    AHEAD,
    is_configured,
    Mount,
    mount_of,
    SettingsT,
    with_mount,
)
from visual_servo_epipolar.messages import read, transforms
from visual_servo_epipolar.nodes import qos
from visual_servo_epipolar.nodes.managed import in_every_state

Transform = tuple[FloatArray, FloatArray]


class TransformBroadcaster:
    """Publishes transforms on /tf, or ``static`` ones on /tf_static; none without tf2_msgs."""

    def __init__(self, node: Node, *, static: bool = False) -> None:
        topic, profile = ('/tf_static', qos.LATCHED) if static else ('/tf', qos.TRANSFORMS)
        self._kind = transforms.tf_message_class()
        self._publisher = None
        if self._kind is not None:
            self._publisher = node.create_publisher(self._kind, topic, profile)
        else:
            node.get_logger().info(transforms.without_tf2_msgs(f'{topic} is not published'))

    def send(self, messages: Sequence[TransformStamped]) -> None:
        """Publish all ``messages`` as one; a static one replaces what was sent before."""
        if self._kind is not None and self._publisher is not None:
            self._publisher.publish(self._kind(transforms=list(messages)))


class StaticMount:
    """
    Keeps the static transforms of a robot, and finds in them how its camera is mounted.

    Nothing is known unless it ``listens``, nor without tf2_msgs, which it says. What cannot be
    used is logged by ``warn``; ``trouble`` tells of a mount that is known and cannot be used, ''
    where there is none: a node that drives all the same assumes a camera that looks ahead. The
    ``base_frame`` may become known later.
    """

    def __init__(
        self, node: Node, base_frame: str, warn: Callable[[str], None], *, listens: bool
    ) -> None:
        self.base_frame, self._log, self._warn = base_frame, node.get_logger(), warn
        self._taken, self.trouble = False, ''
        self._parents: dict[str, tuple[str, Transform]] = {}
        kind = transforms.tf_message_class() if listens else None
        self._is_heard = kind is not None
        if listens and kind is None:
            self._log.warning(transforms.without_tf2_msgs('mount_from_tf has no effect'))
        elif kind is not None:
            node.create_subscription(kind, '/tf_static', self.receive, qos.STATIC_TRANSFORMS)

    @in_every_state
    def receive(self, message: Any) -> None:
        """Take in a tf2_msgs/TFMessage; a transform that cannot be used is left out and logged."""
        for item in message.transforms:
            try:
                parent = item.header.frame_id, read.transform(item)
                self._parents[item.child_frame_id] = parent
            except ValueError as error:
                self._warn(f'/tf_static: {error}')

    def taken(self, camera_frame: str, settings: SettingsT) -> SettingsT:
        """Return ``settings`` with the mount of a camera in /tf_static, where they have none."""
        self.trouble = ''
        if is_configured(settings):
            return settings
        try:
            mount = self.of(camera_frame)
            configured = settings if mount is None else with_mount(settings, mount)
        except ValueError as error:
            self.trouble = (
                f'the mount of {camera_frame} in /tf_static cannot be used: {error}; or say '
                'mount_from_tf: false, and the mount by the camera_ settings'
            )
            self._warn(self.trouble)
            return settings
        if mount is None:
            self._miss(camera_frame)
        else:
            self._taken = True
            self._log.info(f'/tf_static: {camera_frame} sits at {mount}')
        return configured

    def _miss(self, frame: str) -> None:
        """Warn that /tf_static, where it is heard at all, does not lead to a camera."""
        if self._is_heard and frame != self.base_frame:
            has = ', '.join(sorted(self._parents)) or 'nothing'
            self._warn(
                f'mount_from_tf: /tf_static does not lead from {self.base_frame} to {frame!r:.40},'
                f' the frame of images; it has {has:.200}; mend the frame_id of the driver or the '
                'transforms'
            )

    def dropped(self, settings: SettingsT) -> SettingsT:
        """Return ``settings`` without the mount that they took: the next may be another."""
        if not self._taken:
            return settings
        self._taken = False
        return with_mount(settings, AHEAD)

    def of(self, camera_frame: str) -> Mount | None:
        """Return how the camera of a frame is mounted, None if unknown; or raise ValueError."""
        frame, rotation, origin = camera_frame, np.eye(3), np.zeros(3)
        for _ in range(len(self._parents) + 1):  # more are a circle
            if frame == self.base_frame:
                return None if frame == camera_frame else mount_of(rotation, origin)
            if frame not in self._parents:
                return None
            frame, (turn, place) = self._parents[frame]
            rotation, origin = turn @ rotation, turn @ origin + place
        return None
