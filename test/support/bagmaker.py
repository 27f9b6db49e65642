"""Bags for tests: a real run of the real nodes, every message as rclpy serialized it."""

from collections.abc import Callable, Mapping, Sequence
from functools import partial
from pathlib import Path
from types import MappingProxyType
from typing import Any, NamedTuple

from diagnostic_msgs.msg import DiagnosticArray
from geometry_msgs.msg import Twist
from nav_msgs.msg import Odometry
from rclpy.context import Context
from rclpy.node import Node
from rclpy.qos import QoSProfile
from rosbags.rosbag2 import CompressionFormat, CompressionMode, StoragePlugin, Writer
from rosbags.typesys import get_typestore, Stores
from sensor_msgs.msg import CameraInfo, Image, JointState, PointCloud2
import small_cameras
from std_msgs.msg import String

from visual_servo_epipolar.bags.reading.bag import Bag
from visual_servo_epipolar.bags.reading.run import read_run, Recording
from visual_servo_epipolar.bags.reading.topics import assign_roles
from visual_servo_epipolar.bags.replaying.comparison import compare, Comparison
from visual_servo_epipolar.bags.replaying.plan import plan, ReplayOverrides
from visual_servo_epipolar.bags.replaying.replay import replay, ReplayedStep
from visual_servo_epipolar.nodes import qos
from visual_servo_epipolar.nodes.lockstep import Lockstep, ObserverNode
from visual_servo_epipolar.simulation.closed_loop import LoopSettings, RunMonitor
from visual_servo_epipolar.simulation.scenario import from_document, Scenario

TYPES = get_typestore(Stores.ROS2_JAZZY)
DEEP = QoSProfile(depth=20)
TOPICS: dict[str, tuple[Any, QoSProfile]] = {
    '/image_raw': (Image, DEEP),
    '/camera_info': (CameraInfo, DEEP),
    '/desired/image_raw': (Image, qos.LATCHED),
    '/tracker_node/desired/image_raw': (Image, qos.LATCHED),
    '/tracker_node/settings': (String, qos.LATCHED),
    '/servo_node/settings': (String, qos.LATCHED),
    '/tracker_node/events': (String, DEEP),
    '/servo_node/events': (String, DEEP),
    '/tracks': (PointCloud2, DEEP),
    '/epipoles': (JointState, DEEP),
    '/diagnostics': (DiagnosticArray, DEEP),
    '/cmd_vel': (Twist, DEEP),
    '/ground_truth': (Odometry, DEEP),
}
TINY = {
    'camera': {**small_cameras.TINY, 'frame_rate': 3.0},
    'run': {'max_duration': 1.0},
}
Message = tuple[str, int, bytes]  # topic, time of recording [ns], CDR


def small_scenario(max_duration: float, **servo: Any) -> Scenario:
    """Return a run through a camera of 320x256 px, the real one with its pixels binned."""
    camera = small_cameras.sized(320, 256, 769.2307692307693 / 4.0, 158.375, 127.625)
    document = {'camera': camera, 'run': {'max_duration': max_duration}, 'servo': servo}
    return from_document(document, 'test')


def tiny_run() -> list[Message]:
    """Return all that was said in the first steps of a run through a very small camera."""
    scenario = from_document(TINY, 'tiny')
    return drive(scenario, scenario.loop((0.2, -1.5, 0.0), 0))


def drive(scenario: Scenario, settings: LoopSettings) -> list[Message]:
    """Let the nodes drive, and return all their messages in the order of reception."""
    monitor = RunMonitor(settings)
    with Lockstep(scenario, settings) as nodes:
        listener, received = new_listener(nodes.context)
        nodes.add(listener)
        nodes.add(ObserverNode(monitor, lambda *_: None, with_images=False, context=nodes.context))
        nodes.run(lambda: monitor.done)
    return received


def new_listener(context: Context) -> tuple[Node, list[Message]]:
    """Return a node that subscribes to all topics, and the messages it received."""
    received: list[Message] = []
    listener = Node('listener', context=context)

    def listen(topic: str, raw: bytes, *_: object) -> None:  # the executor of events adds an info
        received.append((topic, 1_000 + len(received), bytes(raw)))

    for topic, (kind, profile) in TOPICS.items():
        listener.create_subscription(kind, topic, partial(listen, topic), profile, raw=True)
    return listener, received


def kind_of(topic: str) -> str:
    """Return the type of one of the topics above, as bags name it."""
    kind = TOPICS[topic][0]
    return f'{kind.__module__.split(".")[0]}/msg/{kind.__name__}'


def decoded(message: Message) -> Any:
    """Return a message as rosbags reads it."""
    return TYPES.deserialize_cdr(message[2], kind_of(message[0]))


def write_bag(
    path: Path,
    messages: Sequence[Message],
    *,
    storage: StoragePlugin = StoragePlugin.MCAP,
    compression: CompressionMode = CompressionMode.NONE,
    kinds: Mapping[str, str] = MappingProxyType({}),
) -> Path:
    """Write a bag of ``messages`` and return its folder; ``kinds`` are types of other topics."""
    writer = Writer(path, version=9, storage_plugin=storage)
    if compression is not CompressionMode.NONE:
        writer.set_compression(compression, CompressionFormat.ZSTD)
    writer.open()
    try:
        connections = {
            topic: writer.add_connection(
                topic, kinds.get(topic) or kind_of(topic), typestore=TYPES
            )
            for topic in dict.fromkeys(topic for topic, _, _ in messages)
        }
        for topic, log_ns, raw in messages:
            writer.write(connections[topic], log_ns, raw)
    finally:
        writer.close()
    return path


class Replay(NamedTuple):
    """A replayed bag: what was recorded, what came of it, and how they compare."""

    run: Recording
    steps: list[ReplayedStep]
    comparison: Comparison


def replayed(
    path: Path,
    topics: Mapping[str, str] = MappingProxyType({}),
    *,
    tolerance: float = 0.0,
    known: Callable[[Recording], Recording] = lambda run: run,
    **overrides: Any,
) -> Replay:
    """Replay the bag at ``path``, of which so much is ``known``, and compare."""
    with Bag(path) as bag:
        run = known(read_run(bag, assign_roles(bag, topics)))
        steps = replay(bag, run, plan(bag, run, ReplayOverrides(**overrides))[0])
    return Replay(run, steps, compare(run, steps, tolerance))


def twists(steps: Sequence[ReplayedStep]) -> list[tuple[float, float]]:
    """Return the commands of a replay."""
    return [(step.telemetry['linear_m_s'], step.telemetry['angular_rad_s']) for step in steps]


def published(messages: Sequence[Message]) -> list[tuple[float, float]]:
    """Return the commands of a run."""
    sent = [decoded(item) for item in messages if item[0] == '/cmd_vel']
    return [(item.linear.x, item.angular.z) for item in sent]
