"""The driven path over ROS: odometry or commands in, where the base was at a stamp out."""

from collections.abc import Callable
from typing import Any

from nav_msgs.msg import Odometry
from rclpy.node import Node

from visual_servo_epipolar.core.docking.path import Path, PathPlace
from visual_servo_epipolar.messages import read, write
from visual_servo_epipolar.nodes import qos
from visual_servo_epipolar.nodes.servoing.rivals import type_mismatch
from visual_servo_epipolar.nodes.startup.settings import DockNodeSettings, RouteNodeSettings


class DrivenPath:
    """
    Path of the base of ``node``, by odometry or commands as its ``settings`` say.

    ``on_odometry`` is called when it grows by odometry.
    """

    def __init__(
        self,
        node: Node,
        settings: DockNodeSettings | RouteNodeSettings,
        warn: Callable[[str], None],
        on_odometry: Callable[[], None],
    ) -> None:
        self.path, self.frame = Path(), ''
        self._node, self._warn, self._on_odometry = node, warn, on_odometry
        self._stamped = settings.enable_stamped_cmd_vel
        self._predicts = settings.path_source == 'commands'  # until the next command
        if self._predicts:
            kind = write.twist_type(stamped=self._stamped)
            node.create_subscription(kind, 'cmd_vel', self._take_command, qos.COMMAND)
        else:
            node.create_subscription(Odometry, 'odom', self._take_odometry, qos.ODOMETRY)

    def begin_anew(self) -> None:
        """Forget the path: what was driven since its end is not known."""
        self.path, self.frame = Path(), ''

    def at(self, stamp_ns: int) -> PathPlace | None:
        """Return where the base was at a stamp, None where the path does not reach."""
        return self.path.at(stamp_ns, predict=self._predicts)

    def may_reach(self, stamp_ns: int) -> bool:
        """Return whether the path, as it goes on, may come to a stamp."""
        return self.path.last_ns is None or stamp_ns > self.path.last_ns

    @property
    def missing(self) -> str:
        """What tracks wait for that the path does not reach."""
        source = 'cmd_vel' if self._predicts else 'odom'
        mismatch = type_mismatch(self._node, takes=True) if self._predicts else ''
        if mismatch:
            return mismatch
        if self.path.last_ns is None:
            topic = self._node.resolve_topic_name(source)
            return f'nothing came on {topic} yet; start what publishes it, or remap {source}'
        return f'no {source} for these tracks: are its stamps those of another clock?'

    def _take_odometry(self, message: Odometry) -> None:
        try:
            self.path.add_pose(read.stamp_ns(message.header), read.pose(message))
        except ValueError as error:
            self._warn(f'odometry refused: {error}')
            return
        self.frame = message.header.frame_id
        self._on_odometry()

    def _take_command(self, message: Any) -> None:
        now_ns = int(self._node.get_clock().now().nanoseconds)
        try:
            twist = read.twist(message)
        except ValueError as error:
            self._warn(f'a command is refused: {error}')
            return
        self.path.add_twist(read.stamp_ns(message.header) if self._stamped else now_ns, twist)
