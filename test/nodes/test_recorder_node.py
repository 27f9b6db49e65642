"""The recorder node: what is published lies in the bag, and the robot never waits for it."""

from rclpy.qos import QoSProfile, ReliabilityPolicy

from visual_servo_epipolar.nodes.recorder_node import RecorderNode

BEST_EFFORT = QoSProfile(depth=50, reliability=ReliabilityPolicy.BEST_EFFORT)


def start(bench, tmp_path, **values):
    """Start a recorder of ``tmp_path / 'bag'`` that keeps a little of the disk free."""
    return bench.start(RecorderNode, bag=str(tmp_path / 'bag'), **values)


def wait_until_recorded(bench, node, *topics: str) -> None:
    bench.until(lambda: set(topics) <= node.recorded, f'{", ".join(topics)} to be recorded')
