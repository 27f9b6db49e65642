"""Quality-of-service profiles, each with its reason."""

from rclpy.duration import Duration
from rclpy.qos import DurabilityPolicy, QoSProfile, ReliabilityPolicy

# What we publish is reliable, as profiles are where they do not say it, so that either kind of
# subscriber connects and no step is lost. Depth 1: in a control loop a second-newest message is
# worth nothing.
STREAM = COMMAND = QoSProfile(depth=1)
# A photograph, or a state, must reach subscribers that come late.
LATCHED = QoSProfile(depth=1, durability=DurabilityPolicy.TRANSIENT_LOCAL)
ACKNOWLEDGEMENT = Duration(seconds=0.2)  # longest wait until a last message is acknowledged
# /clock as ROS defines it.
CLOCK = QoSProfile(depth=1, reliability=ReliabilityPolicy.BEST_EFFORT)
DIAGNOSTICS = QoSProfile(depth=10)
# Switches that several may press: at depth 1 a press is lost where another message, also of
# another publisher, comes after it while images are looked at.
SWITCH = QoSProfile(depth=20, reliability=ReliabilityPolicy.BEST_EFFORT)
LATCHED_SWITCH = QoSProfile(depth=20, durability=DurabilityPolicy.TRANSIENT_LOCAL)
# Any driver's odometry; what comes while images are looked at is needed for the next ones.
ODOMETRY = QoSProfile(depth=50, reliability=ReliabilityPolicy.BEST_EFFORT)
# /tf as in tf2: many publish on it.
TRANSFORMS = QoSProfile(depth=100)
# /tf_static as in tf2: latched, and depth 1 would keep that of one publisher alone.
STATIC_TRANSFORMS = QoSProfile(depth=100, durability=DurabilityPolicy.TRANSIENT_LOCAL)

# A reliable subscriber never connects to a best-effort camera driver; a best-effort one connects
# to every driver but loses large images on default transports. Hence a choice, and auto, which
# finds out (AdaptiveSubscription).
IMAGES = {
    'reliable': STREAM,
    'best_effort': QoSProfile(depth=1, reliability=ReliabilityPolicy.BEST_EFFORT),
}
