"""A node that answers each image by an empty twist: the floor of any servo in rclpy."""

import sys
from typing import Any

from geometry_msgs.msg import TwistStamped
from rclpy.node import Node
from sensor_msgs.msg import Image

from visual_servo_epipolar.nodes import qos
from visual_servo_epipolar.nodes.startup.run import spin

IMAGES, ANSWERS = 'echo/image_raw', 'echo/cmd_vel'


class EchoNode(Node):
    """Image in, stamped twist out; with the QoS of tracker and servo."""

    def __init__(self, **options: Any) -> None:
        super().__init__('echo_node', **options)
        self._answer_pub = self.create_publisher(TwistStamped, ANSWERS, qos.COMMAND)
        self.create_subscription(Image, IMAGES, self._on_image, qos.IMAGES['reliable'])

    def _on_image(self, message: Image) -> None:
        answer = TwistStamped()
        answer.header.stamp = message.header.stamp
        self._answer_pub.publish(answer)


def main() -> None:
    """Run the node."""
    sys.exit(spin(EchoNode))


if __name__ == '__main__':
    main()
