"""Quality-of-service profiles, each with its reason."""

from collections.abc import Callable
from typing import Any

from rclpy.event_handler import PublisherEventCallbacks
from rclpy.node import Node
from rclpy.publisher import Publisher
from rclpy.qos import DurabilityPolicy, HistoryPolicy, QoSProfile, ReliabilityPolicy


def _newest(
    reliability: ReliabilityPolicy, durability: DurabilityPolicy = DurabilityPolicy.VOLATILE
) -> QoSProfile:
    """Depth 1: in a control loop a second-newest message is worth nothing."""
    return QoSProfile(
        history=HistoryPolicy.KEEP_LAST, depth=1, reliability=reliability, durability=durability
    )


# What we publish is reliable, so that either kind of subscriber connects and no step is lost.
STREAM = _newest(ReliabilityPolicy.RELIABLE)
COMMAND = _newest(ReliabilityPolicy.RELIABLE)
# A photograph, or a state, must reach those who come late.
LATCHED = _newest(ReliabilityPolicy.RELIABLE, DurabilityPolicy.TRANSIENT_LOCAL)
# /clock as ROS defines it.
CLOCK = _newest(ReliabilityPolicy.BEST_EFFORT)
DIAGNOSTICS = QoSProfile(depth=10)
# Switches that anybody may press: at depth 1 a press is lost where another message, also of
# another publisher, comes after it while images are looked at.
SWITCH = QoSProfile(depth=20, reliability=ReliabilityPolicy.BEST_EFFORT)
LATCHED_SWITCH = QoSProfile(depth=20, durability=DurabilityPolicy.TRANSIENT_LOCAL)
# Any driver's odometry; what comes while images are looked at is needed for the next ones.
ODOMETRY = QoSProfile(depth=50, reliability=ReliabilityPolicy.BEST_EFFORT)
# /tf as tf2 has it: many publish on it.
TRANSFORMS = QoSProfile(depth=100)
# /tf_static as tf2 has it: latched, and depth 1 would keep that of one publisher alone.
STATIC_TRANSFORMS = QoSProfile(depth=100, durability=DurabilityPolicy.TRANSIENT_LOCAL)

# A reliable subscriber never connects to a best-effort camera driver; a best-effort one connects
# to every driver but loses large images on default transports. Hence a choice, and auto, which
# finds out (AdaptiveSubscription).
IMAGES = {
    'reliable': _newest(ReliabilityPolicy.RELIABLE),
    'best_effort': _newest(ReliabilityPolicy.BEST_EFFORT),
}


def report_publisher(node: Node, kind: Any, topic: str, profile: QoSProfile) -> Publisher:
    """Create a publisher for people; it says nothing of other QoS, which costs two entities."""
    silent = PublisherEventCallbacks(use_default_callbacks=False)
    return node.create_publisher(kind, topic, profile, event_callbacks=silent)


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
        self._profiles = {**IMAGES, 'latched': LATCHED}
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
        """Return what suits all who publish messages of this type; as it is without any."""
        expected = f'{self._kind.__module__.partition(".")[0]}/msg/{self._kind.__name__}'
        publishers = self._node.get_publishers_info_by_topic(self._subscription.topic_name)
        offered = [item.qos_profile for item in publishers if item.topic_type == expected]
        if not offered:
            return self._offer
        if self._configured == 'best_effort':  # which DDS hands nothing on that was said before
            return self._configured
        reliable = all(item.reliability == ReliabilityPolicy.RELIABLE for item in offered)
        if reliable and all(item.durability == LATCHED.durability for item in offered):
            return 'latched'
        return 'reliable' if reliable or self._configured == 'reliable' else 'best_effort'

    def _subscribe(self, offer: str) -> None:
        self._offer = offer
        self._subscription = self._node.create_subscription(
            self._kind, self._topic, self._callback, self._profiles[offer]
        )
