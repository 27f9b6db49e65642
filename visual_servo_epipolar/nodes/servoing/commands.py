"""Commands of the servo: twists on cmd_vel."""

from geometry_msgs.msg import Twist as TwistMessage
from geometry_msgs.msg import TwistStamped
from rclpy.duration import Duration
from rclpy.node import Node

from visual_servo_epipolar.core.control.command import Command
from visual_servo_epipolar.messages import write
from visual_servo_epipolar.nodes import qos
from visual_servo_epipolar.nodes.startup.settings import ServoNodeSettings

STOP_TIMEOUT_S = 0.2


class Commands:
    """Commands of the servo ``node`` to the base."""

    def __init__(self, node: Node, settings: ServoNodeSettings) -> None:
        self._stamped, self._frame = settings.enable_stamped_cmd_vel, settings.base_frame
        kind = TwistStamped if self._stamped else TwistMessage
        self._command_pub = node.create_publisher(kind, 'cmd_vel', qos.COMMAND)

    def send(self, command: Command, stamp_ns: int) -> None:
        """Publish ``command``: its twist on cmd_vel."""
        if self._stamped:
            self._command_pub.publish(write.twist_stamped(command.twist, stamp_ns, self._frame))
        else:
            self._command_pub.publish(write.twist(command.twist))

    def wait(self) -> None:
        """Wait until the last command is acknowledged."""
        self._command_pub.wait_for_all_acked(Duration(seconds=STOP_TIMEOUT_S))
