"""The last word of a node: it waits until that is acknowledged, not for a listener that hangs."""

from collections.abc import Callable
from contextlib import ExitStack
from pathlib import Path
import signal
import sys
import time
from typing import Any

from bench import Bench, next_domain
from durations import few_of
from geometry_msgs.msg import Twist as TwistMessage
from node_process import environment, started
import pytest
from sensor_msgs.msg import CameraInfo, Image, PointCloud2
from servo_rig import Rig

from visual_servo_epipolar.messages import write
from visual_servo_epipolar.nodes.route_node import RouteNode
from visual_servo_epipolar.nodes.tracker_node import TrackerNode

# What is acknowledged takes milliseconds; one that hangs is given up by DDS after 20 s.
SOON_SEC, LATE_SEC = 0.1, 5.0
LISTEN = """
from importlib import import_module
import sys
import rclpy

module, kind, topic = sys.argv[1:]
rclpy.init(args=[])
node = rclpy.create_node('listener')
node.create_subscription(getattr(import_module(module), kind), topic, lambda message: None, 1)
rclpy.spin(node)
"""


class Hall:
    """A bench that other processes can listen to, and one that does."""

    def __init__(self, stack: ExitStack, folder: Path) -> None:
        self._stack, self._log, self._domain = stack, folder / 'log', next_domain()
        self.bench = stack.enter_context(Bench(self._domain))

    def freeze(self, kind: type[Any], topic: str, node: Any) -> None:
        """Let a process listen to what ``node`` publishes, and hang from then on."""
        (publisher,) = (it for it in node.publishers if it.topic_name == f'/{topic}')
        before = publisher.get_subscription_count()
        command = [sys.executable, '-c', LISTEN, kind.__module__, kind.__name__, topic]
        listener = started(self._stack, environment(self._domain), command, self._log)
        found = lambda: publisher.get_subscription_count() > before  # noqa: E731
        self.bench.until(found, 'the listener to be found')
        listener.send_signal(signal.SIGSTOP)


@pytest.fixture
def hall(stack: ExitStack, tmp_path: Path) -> Hall:
    return Hall(stack, tmp_path)


def assert_waits(last_word: Callable[[], object]) -> None:
    """Let a node publish its last word to one that hangs: it waits, but not for ever."""
    began = time.monotonic()
    last_word()
    assert SOON_SEC < time.monotonic() - began < LATE_SEC


@pytest.mark.parametrize(
    'end',
    few_of([lambda node: node.stop, lambda node: node.trigger_deactivate], keep=(1,)),
    ids=['stop', 'deactivate'],
)
def test_a_servo_waits_for_the_base_to_hear_of_its_end(hall, end) -> None:
    rig = Rig(hall.bench)
    hall.freeze(TwistMessage, 'cmd_vel', rig.node)
    rig.drive()
    assert_waits(end(rig.node))


@pytest.mark.parametrize('end', few_of(['trigger_deactivate', 'trigger_shutdown'], keep=(0,)))
def test_a_repetition_waits_for_the_base_to_hear_of_its_end(hall, end) -> None:
    node = hall.bench.start(RouteNode)
    hall.freeze(TwistMessage, 'cmd_vel', node)
    assert_waits(getattr(node, end))


def test_a_tracker_waits_for_the_servo_to_hear_of_its_end(hall, simulator, view) -> None:
    bench = hall.bench
    node = bench.start(TrackerNode)
    hall.freeze(PointCloud2, 'tracks', node)
    clouds = bench.listen(PointCloud2, 'tracks')
    bench.talk(CameraInfo, 'camera_info')(write.camera_info(simulator.camera, 1, 'camera'))
    bench.talk(Image, 'image_raw')(write.image(view, 'mono8', 1, 'camera'))
    bench.until(lambda: bool(clouds), 'tracks')
    assert_waits(node.trigger_deactivate)
