"""Subscriptions to a camera: as its driver offers its topics, which is found out."""

from collections.abc import Callable
from typing import Any

from rclpy.clock import Clock, ClockType
from rclpy.node import Node
from rclpy.qos import QoSProfile, ReliabilityPolicy
from sensor_msgs.msg import CompressedImage, Image

from visual_servo_epipolar.nodes import qos

LOOK_PERIOD_S = 0.5
# Until a driver is there: who is reliable loses none, and who is not is soon found out.
FIRST = 'reliable'
TRANSPORTS: dict[str, tuple[Any, str]] = {
    'raw': (Image, ''),
    'compressed': (CompressedImage, '/compressed'),
}


class CameraSubscriptions:
    """
    Subscriptions of ``node`` to the topics of a camera; images are raw or compressed.

    A reliable one never connects to a driver that publishes best effort, a best-effort one loses
    large images. With ``reliability`` auto each is made anew where what is offered asks for it.
    """

    def __init__(self, node: Node, transport: str, reliability: str) -> None:
        self._node, self._transport = node, TRANSPORTS[transport]
        self._fixed = None if reliability == 'auto' else reliability
        self._subscriptions: list[Subscription] = []
        if self._fixed is None:
            clock = Clock(clock_type=ClockType.STEADY_TIME)
            node.create_timer(LOOK_PERIOD_S, self._look, clock=clock)

    def create_subscription(
        self,
        kind: Any,
        topic: str,
        callback: Callable[[Any], None],
        profile: QoSProfile | None = None,
    ) -> None:
        """Subscribe to ``topic``, with a ``profile`` of the driver's unless it is given."""
        if kind is Image:
            kind, suffix = self._transport
            # Beside the raw images, wherever those are remapped to.
            topic = f'{self._node.resolve_topic_name(topic)}{suffix}' if suffix else topic
        if profile is not None:
            self._node.create_subscription(kind, topic, callback, profile)
            return
        reliability = self._fixed or FIRST
        self._subscriptions.append(Subscription(self._node, kind, topic, callback, reliability))

    def _look(self) -> None:
        for item in self._subscriptions:
            item.adapt()


class Subscription:
    """One subscription, which may be made anew with another reliability."""

    def __init__(
        self,
        node: Node,
        kind: Any,
        topic: str,
        callback: Callable[[Any], None],
        reliability: str,
    ) -> None:
        self._node, self._kind, self._topic, self._callback = node, kind, topic, callback
        self._subscribe(reliability)

    def adapt(self) -> None:
        """Subscribe anew if the publishers that are there offer something else."""
        offered = self._offered()
        if not offered:
            return
        fitting = 'reliable' if offered == {ReliabilityPolicy.RELIABLE} else 'best_effort'
        if fitting != self._reliability:
            self._node.destroy_subscription(self._subscription)
            self._subscribe(fitting)
            name = self._subscription.topic_name
            self._node.get_logger().info(f'{name} is published as {fitting}, and so subscribed')

    def _offered(self) -> set[ReliabilityPolicy]:
        """Return the reliabilities of those who publish messages of this type on the topic."""
        expected = f'{self._kind.__module__.partition(".")[0]}/msg/{self._kind.__name__}'
        publishers = self._node.get_publishers_info_by_topic(self._subscription.topic_name)
        return {item.qos_profile.reliability for item in publishers if item.topic_type == expected}

    def _subscribe(self, reliability: str) -> None:
        self._reliability = reliability
        self._subscription = self._node.create_subscription(
            self._kind, self._topic, self._callback, qos.IMAGES[reliability]
        )
