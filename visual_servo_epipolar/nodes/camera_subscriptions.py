"""Subscriptions to a camera: by the QoS that its driver offers."""

from collections.abc import Callable
from typing import Any

from rclpy.node import Node
from rclpy.qos import QoSProfile, ReliabilityPolicy
from sensor_msgs.msg import CompressedImage, Image

from visual_servo_epipolar.messages.validation import of_two_cameras
from visual_servo_epipolar.nodes import qos
from visual_servo_epipolar.nodes.steady import LOOK_PERIOD_S, STEADY

TRANSPORTS: dict[str, tuple[Any, str]] = {
    'raw': (Image, ''),
    'compressed': (CompressedImage, '/compressed'),
}


class AdaptiveSubscription:
    """
    Subscription of ``node`` to ``topic`` as its publishers offer it, made anew where they change.

    A reliable one never connects to a publisher that is best effort, a best-effort one loses large
    images; what was published once and latched reaches late joiners only if they ask for it. A
    ``reliability`` other than auto holds; ``adapt`` is to be called now and then.
    """

    def __init__(
        self,
        node: Node,
        kind: Any,
        topic: str,
        callback: Callable[[Any], None],
        reliability: str,
    ) -> None:
        self._node, self._kind, self._topic, self._callback = node, kind, topic, callback
        self._configured = reliability
        self._profiles = {**qos.IMAGES, 'latched': qos.LATCHED}
        self._subscribe('reliable' if reliability == 'auto' else reliability)

    def adapt(self) -> None:
        """Subscribe anew if the publishers that are there offer something else."""
        fitting = self._fitting()
        if fitting != self._offer:
            self._node.destroy_subscription(self._subscription)
            self._subscribe(fitting)
            name = self._subscription.topic_name
            self._node.get_logger().info(f'{name} is published as {fitting}, and so subscribed')

    def _fitting(self) -> str:
        """Return what suits all publishers of this type; as it is without any."""
        expected = f'{self._kind.__module__.partition(".")[0]}/msg/{self._kind.__name__}'
        publishers = self._node.get_publishers_info_by_topic(self._subscription.topic_name)
        offered = [item.qos_profile for item in publishers if item.topic_type == expected]
        if not offered:
            return self._offer
        if self._configured == 'best_effort':  # to which DDS hands no earlier message
            return self._configured
        reliable = all(item.reliability == ReliabilityPolicy.RELIABLE for item in offered)
        if reliable and all(item.durability == qos.LATCHED.durability for item in offered):
            return 'latched'
        return 'reliable' if reliable or self._configured == 'reliable' else 'best_effort'

    def _subscribe(self, offer: str) -> None:
        self._offer = offer
        self._subscription = self._node.create_subscription(
            self._kind, self._topic, self._callback, self._profiles[offer]
        )


class CameraSubscriptions:
    """Subscriptions of ``node`` to a camera; ``info_frame`` is the frame_id of its camera_info."""

    def __init__(self, node: Node, transport: str, reliability: str) -> None:
        self._node, self._transport = node, TRANSPORTS[transport]
        self._reliability = reliability
        self._subscriptions: list[AdaptiveSubscription] = []
        self.info_frame = self._doubt = ''
        node.create_timer(LOOK_PERIOD_S, self._look, clock=STEADY)

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
        self._subscriptions.append(
            AdaptiveSubscription(self._node, kind, topic, callback, self._reliability)
        )

    def _look(self) -> None:
        for item in self._subscriptions:
            item.adapt()

    def compare_frames(self, image_frame: str) -> None:
        """Say once if images of this frame and camera_info may be of two cameras."""
        topics = [self._node.resolve_topic_name(name) for name in ('image_raw', 'camera_info')]
        doubt = of_two_cameras((topics[0], topics[1]), (image_frame, self.info_frame))
        if doubt and doubt != self._doubt:
            self._doubt = doubt
            self._node.get_logger().warning(
                f'{doubt}; remap camera_info to that of the camera which the images come from'
            )
