"""Whatever is published, of whatever type: the recorder takes it down, or leaves the topic out."""

from bag_reading import read_back
from bench import Bench
import fuzzing
from geometry_msgs.msg import TwistStamped
from nav_msgs.msg import Odometry
import numpy as np
from rclpy.serialization import serialize_message
from sensor_msgs.msg import CameraInfo, PointCloud2
from std_msgs.msg import Bool, String

from visual_servo_epipolar.nodes.recorder_node import RecorderNode

KINDS = {
    'tracks': PointCloud2,
    'camera_info': CameraInfo,
    'odom': Odometry,
    'cmd_vel': TwistStamped,
    'phase': String,
    'stop_button': Bool,
}
BATCH = 10  # messages between two looks at what has come


def test_all_that_is_published_is_in_the_bag_byte_for_byte(bench: Bench, tmp_path) -> None:
    """Also what no subscriber could read: it is recorded as it came."""
    talk = {name: bench.talk(kind, name) for name, kind in KINDS.items()}
    node = bench.start(RecorderNode, bag=str(tmp_path / 'bag'), topics=tuple(KINDS), report=False)
    bench.until(lambda: node.ready, 'the topics to be recorded')
    bench.settle()
    rng, sent = np.random.default_rng(6), []

    def run(count: int) -> float:
        for number in range(count):
            for name, kind in KINDS.items():
                data = serialize_message(fuzzing.anything(kind, rng))
                if rng.random() < 0.3:
                    data = damaged(data, rng)
                talk[name](data)
                sent.append((f'/{name}', data))
            if number % BATCH == 0:
                bench.until(lambda: node.received == len(sent), 'what was sent')
        bench.until(lambda: node.received == len(sent), 'what was sent')
        return fuzzing.resident_mb()

    first = run(fuzzing.COUNT // 2)
    kept = 200e-6 * len(sent) + sum(len(data) for _, data in sent) / 1e6  # by this test itself
    assert run(fuzzing.COUNT // 2) - first < fuzzing.GROWTH_MB + kept
    assert not node.stop().error
    written = sorted((name, bytes(data)) for name, _, data in read_back(tmp_path / 'bag'))
    assert written == sorted(sent)


def damaged(data: bytes, rng) -> bytes:
    """Return bytes of which some are others, after the four that say how they are encoded."""
    changed = bytearray(data)
    for _ in range(4):
        changed[int(rng.integers(4, len(data)))] = int(rng.integers(0, 256))
    return bytes(changed)
