"""Broadcasters of transforms: /tf for what moves, /tf_static for what is screwed on."""

from collections.abc import Sequence

from geometry_msgs.msg import TransformStamped
from rclpy.node import Node

from visual_servo_epipolar.messages import transforms
from visual_servo_epipolar.nodes import qos


class TransformBroadcaster:
    """
    Publishes transforms on /tf, or ``static`` ones on /tf_static, which reach those who come late.

    Without tf2_msgs it says so once, and publishes nothing: headers name the frames all the same.
    """

    def __init__(self, node: Node, *, static: bool = False) -> None:
        topic, profile = ('/tf_static', qos.LATCHED) if static else ('/tf', qos.TRANSFORMS)
        self._kind = transforms.tf_message_class()
        self._publisher = None
        if self._kind is not None:
            self._publisher = node.create_publisher(self._kind, topic, profile)
        else:
            node.get_logger().info(transforms.without_tf2_msgs(f'{topic} is not published'))

    @property
    def publishes(self) -> bool:
        """Whether what is sent is published."""
        return self._publisher is not None

    def send(self, messages: Sequence[TransformStamped]) -> None:
        """Publish all ``messages`` as one; a static one replaces what was sent before."""
        if self._publisher is not None:
            self._publisher.publish(transforms.tf_message(self._kind, messages))
