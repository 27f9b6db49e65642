"""The driven path over ROS: odometry or commands in, the pose of the base at an image out."""

from collections.abc import Callable
from dataclasses import replace
from functools import partial
import math
from typing import Any

from nav_msgs.msg import Odometry
from rclpy.node import Node
from rclpy.qos import QoSProfile

from visual_servo_epipolar.core.geometry.motion import Pose
from visual_servo_epipolar.core.odometry.path import Path
from visual_servo_epipolar.core.twoview.observation import Observation
from visual_servo_epipolar.messages import read, write
from visual_servo_epipolar.nodes import qos
from visual_servo_epipolar.nodes.servoing.rivals import publishers, type_mismatch
from visual_servo_epipolar.nodes.startup.settings import RouteNodeSettings


class DrivenPath:
    """
    Path of the base of ``node``: by odometry, or by commands where its ``settings`` say so.

    What is wrong with it is logged by ``warn``; ``on_odometry`` is called when it grows by
    odometry, which may be ``ahead`` [s] older than an image. It is empty unless it ``listens``.
    ``base_frame`` is the one whose path odometry gives, '' before.
    """

    def __init__(
        self,
        node: Node,
        warn: Callable[[str], object],
        settings: RouteNodeSettings | None = None,
        on_odometry: Callable[[], None] = lambda: None,
        *,
        listens: bool = True,
        ahead: float = 0.0,
        profile: QoSProfile = qos.ODOMETRY,
    ) -> None:
        self._node, self._warn, self._on_odometry = node, warn, on_odometry
        self._listens, self.base_frame = listens, ''
        if settings is None or settings.path_source == 'odometry':
            self._topic, self._ahead = node.resolve_topic_name('odom'), ahead
            if listens:
                node.create_subscription(Odometry, 'odom', self._take_odometry, profile)
        else:  # it obeys the last command, and stands then
            self._topic, self._ahead = node.resolve_topic_name('cmd_vel'), math.inf
            kind = write.twist_type(stamped=settings.enable_stamped_cmd_vel)
            node.create_subscription(kind, 'cmd_vel', self._take_command, qos.COMMAND)
        self.begin_anew()

    def begin_anew(self) -> None:
        """Forget the path: what was driven since its end is not known."""
        by_commands = self._ahead == math.inf
        absent = partial(type_mismatch, self._node, takes=True) if by_commands else str
        self.path, self._epoch = Path(self._topic, ahead=self._ahead, absent=absent), 0

    def with_odometry(self, observation: Observation) -> Observation:
        """Return ``observation`` with where the base was, where that is known."""
        if not self._listens:
            return observation
        place = self.path.at(observation.stamp_ns)
        if place is None:
            self._warn(self.path.missing(observation.stamp_ns))
            return observation
        epoch, self._epoch = self._epoch, place.epoch
        if epoch != place.epoch:  # one image without: two poses are not of one frame
            return observation
        return replace(observation, odometry=Pose(*place.pose.tolist()))

    def _take_odometry(self, message: Odometry) -> None:
        try:
            stamp_ns, pose = read.stamp_ns(message.header), read.pose(message)
        except ValueError as error:
            self._warn(f'odometry refused: {error}')
            return
        self.base_frame = message.child_frame_id
        rupture = self.path.add_pose(stamp_ns, pose, message.header.frame_id)
        if rupture:
            names = ', '.join(sorted(publishers(self._node, self._topic).elements()))
            self.path.rupture = f'{rupture}; look at what publishes it: {names}'
            self._warn(self.path.rupture)
        self._on_odometry()

    def _take_command(self, message: Any) -> None:
        now_ns = int(self._node.get_clock().now().nanoseconds)
        try:
            twist = read.twist(message)
        except ValueError as error:
            self._warn(f'a command is refused: {error}')
            return
        stamped = hasattr(message, 'header')
        self.path.add_twist(read.stamp_ns(message.header) if stamped else now_ns, twist)
