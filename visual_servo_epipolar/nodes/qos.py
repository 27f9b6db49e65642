"""Quality-of-service profiles, each with its reason."""

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
# Any driver's odometry; what comes while images are looked at is needed for the next ones.
ODOMETRY = QoSProfile(depth=50, reliability=ReliabilityPolicy.BEST_EFFORT)
# /tf as tf2 has it: many publish on it.
TRANSFORMS = QoSProfile(depth=100)
# /tf_static as tf2 has it: latched, and depth 1 would keep that of one publisher alone.
STATIC_TRANSFORMS = QoSProfile(depth=100, durability=DurabilityPolicy.TRANSIENT_LOCAL)

# A reliable subscriber never connects to a best-effort camera driver; a best-effort one connects
# to every driver but loses large images on default transports. Hence a choice, and the tracker
# finds out. camera_info is small: best effort is enough.
IMAGES = {
    'auto': _newest(ReliabilityPolicy.BEST_EFFORT),
    'reliable': _newest(ReliabilityPolicy.RELIABLE),
    'best_effort': _newest(ReliabilityPolicy.BEST_EFFORT),
}


def report_publisher(node: Node, kind: Any, topic: str, profile: QoSProfile) -> Publisher:
    """
    Create a publisher of what people look at, which tells of no subscriber of another QoS.

    To tell takes two entities that an executor asks about, and the subscriber tells it as well.
    """
    silent = PublisherEventCallbacks(use_default_callbacks=False)
    return node.create_publisher(kind, topic, profile, event_callbacks=silent)
