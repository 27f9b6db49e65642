"""Reversal: commands of a servo whose camera looks back, reversed for the base."""

from collections.abc import Callable
from typing import Any

from rclpy.duration import Duration
from rclpy.node import Node

from visual_servo_epipolar.core.geometry.motion import STANDSTILL, Twist
from visual_servo_epipolar.messages import read, write
from visual_servo_epipolar.nodes import qos
from visual_servo_epipolar.nodes.servoing.rivals import publishers, TOPIC
from visual_servo_epipolar.nodes.startup.settings import DockNodeSettings

REVERSED, STOP_TIMEOUT_S = 'cmd_vel_reversed', 0.2


class Reversal:
    """
    Turns each command on ``cmd_vel_reversed`` round: what is ahead of the servo is behind.

    A base that drives backwards is one that looks back and drives forwards; turns stay. One
    command for one: where the servo falls silent, so does this, and the base stops by itself. At
    one that is broken the base stands, and ``warn`` is called.
    """

    def __init__(
        self, node: Node, warn: Callable[[str], None], settings: DockNodeSettings
    ) -> None:
        self._node, self._warn, self._base_frame = node, warn, settings.base_frame
        self._stamped = settings.enable_stamped_cmd_vel
        kind = write.twist_type(stamped=self._stamped)
        self._pub = node.create_publisher(kind, TOPIC, qos.COMMAND)
        node.create_subscription(kind, REVERSED, self._turn_round, qos.COMMAND)

    def bypassed(self, servo: str) -> str:
        """Return that ``servo`` itself commands the base, away from the dock; or ''."""
        servo = self._node.resolve_service_name(servo)
        if servo not in publishers(self._node):
            return ''
        topic = self._node.resolve_topic_name(TOPIC)
        return (
            f'{servo} commands {topic} itself, and dock_backwards is true: the robot would drive '
            f'away from the dock; start it with -r cmd_vel:={REVERSED}'
        )

    def stop(self) -> None:
        """Stop the base, and wait until the command is acknowledged."""
        self._publish(STANDSTILL, int(self._node.get_clock().now().nanoseconds))
        self._pub.wait_for_all_acked(Duration(seconds=STOP_TIMEOUT_S))

    def _turn_round(self, message: Any) -> None:
        now_ns = int(self._node.get_clock().now().nanoseconds)
        stamp_ns = read.stamp_ns(message.header) if self._stamped else now_ns
        try:
            ahead = read.twist(message)
        except ValueError as error:
            self._warn(str(error))
            ahead = STANDSTILL
        self._publish(Twist(-ahead.linear, ahead.angular), stamp_ns)

    def _publish(self, twist: Twist, stamp_ns: int) -> None:
        self._pub.publish(write.command(twist, stamp_ns, self._base_frame, stamped=self._stamped))
