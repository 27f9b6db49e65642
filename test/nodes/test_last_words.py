"""The last word of a node: it waits until that is acknowledged, but not for who hangs."""

from collections.abc import Iterator
from contextlib import ExitStack
from typing import Any

from bench import Bench, next_domain
from durations import few_of
from frozen_listener import assert_waits, FrozenListener
from geometry_msgs.msg import Twist as TwistMessage
import pytest
from sensor_msgs.msg import CameraInfo, Image, PointCloud2
from servo_rig import Rig

from visual_servo_epipolar.messages import write
from visual_servo_epipolar.nodes.route_node import RouteNode
from visual_servo_epipolar.nodes.tracker_node import TrackerNode


class Hall:
    """A bench that other processes can listen to, and one that does."""

    def __init__(self, stack: ExitStack) -> None:
        self._stack, self._domain = stack, next_domain()
        self.bench = stack.enter_context(Bench(self._domain))

    def freeze(self, kind: type[Any], topic: str, node: Any) -> None:
        """Let somebody listen to what ``node`` publishes, and hang from then on."""
        (publisher,) = (it for it in node.publishers if it.topic_name == f'/{topic}')
        before = publisher.get_subscription_count()
        listener = FrozenListener(self._stack, self._domain, kind, topic)
        found = lambda: publisher.get_subscription_count() > before  # noqa: E731
        self.bench.until(found, 'the listener to be found')
        listener.freeze()


@pytest.fixture
def hall(monkeypatch: pytest.MonkeyPatch) -> Iterator[Hall]:
    monkeypatch.setenv('ROS_AUTOMATIC_DISCOVERY_RANGE', 'LOCALHOST')
    with ExitStack() as stack:
        yield Hall(stack)


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
