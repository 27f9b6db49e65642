"""Whatever comes on any subscription of the other nodes: they live, say one line, stay small."""

from bench import Bench
import fuzzing
from geometry_msgs.msg import Twist as TwistMessage
from geometry_msgs.msg import TwistStamped
from nav_msgs.msg import Odometry
import numpy as np
import pytest
from sensor_msgs.msg import CameraInfo, PointCloud2

from visual_servo_epipolar.core.geometry.motion import Pose, Twist
from visual_servo_epipolar.messages import read, write
from visual_servo_epipolar.nodes.camera_node import CameraNode
from visual_servo_epipolar.nodes.dock_node import DockNode
from visual_servo_epipolar.nodes.unicycle_node import UnicycleNode

SMALL = {'width': 64, 'height': 48, 'focal_length': 38.0, 'principal_u': 31.5}
SMALL['principal_v'] = 23.5
KINDS = [
    pytest.param(DockNode, {}, id='dock'),
    pytest.param(
        DockNode,
        {'path_source': 'commands', 'dock_backwards': True, 'enable_stamped_cmd_vel': True},
        id='dock backwards',
    ),
    pytest.param(UnicycleNode, {'rate': 1.0}, id='base'),
    pytest.param(UnicycleNode, {'rate': 1.0, 'enable_stamped_cmd_vel': True}, id='stamped base'),
    pytest.param(UnicycleNode, {'lockstep': True, 'begin': False}, id='base in lockstep'),
    pytest.param(CameraNode, SMALL, id='camera'),
]


def sent_to(node, rng) -> None:
    """Hand one message, or one that is nearly right, to each subscription of a ``node``."""
    for item in list(node.subscriptions):
        message = nearly(item.msg_type, rng) if rng.random() < 0.5 else None
        item.callback(fuzzing.wired(message or fuzzing.anything(item.msg_type, rng)))


def nearly(kind, rng):
    """Return a message that makes sense but for one of its numbers, None of other types."""
    stamp_ns, number = int(rng.integers(0, 2**33)), float(rng.choice(fuzzing.NUMBERS))
    if kind is Odometry:
        pose, twist = Pose(*rng.uniform(-5.0, 5.0, 3)), Twist(0.1, 0.1)
        message = write.odometry(pose, twist, stamp_ns, 'odom', 'base_link')
        fields = [message.pose.pose.position, message.pose.pose.orientation]
        setattr(fields[rng.integers(0, 2)], str(rng.choice(['x', 'y', 'z'])), number)
        return message
    if kind is PointCloud2:
        return fuzzing.nearly_tracks(rng, stamp_ns)
    if kind is CameraInfo:
        return fuzzing.nearly_camera(rng)
    if kind is TwistMessage:
        return write.twist(Twist(number if np.isfinite(number) else 9.0, 0.1))
    if kind is TwistStamped:
        return write.twist_stamped(Twist(0.1, 0.1), stamp_ns, str(rng.choice(fuzzing.WORDS)))
    return None


@pytest.mark.parametrize(('kind', 'values'), KINDS)
def test_a_node_outlives_all_that_it_hears(bench: Bench, kind, values) -> None:
    node = bench.start(kind, **values)

    def run(count: int) -> float:
        rng = np.random.default_rng(2)
        for number in range(count):
            sent_to(node, rng)
            if number % 20 == 0:
                bench.executor.spin_once(timeout_sec=0.0)
        return fuzzing.resident_mb()

    first = run(fuzzing.COUNT // 2)
    assert run(fuzzing.COUNT // 2) - first < fuzzing.GROWTH_MB
    bench.settle()
    assert not [log for log in bench.logs if '\n' in log.msg or len(log.msg) > 500]


def test_the_base_never_leaves_its_limits(bench: Bench) -> None:
    node = bench.start(UnicycleNode, lockstep=True, begin=False)
    rng = np.random.default_rng(3)
    for _ in range(fuzzing.COUNT):
        sent_to(node, rng)
        assert abs(node._base.twist.linear) <= node._base_settings.max_linear * 1.01
        assert abs(node._base.twist.angular) <= node._base_settings.max_angular * 1.01
    assert np.isfinite([node._base.pose.x, node._base.pose.y, node._base.pose.theta]).all()


def test_commands_that_are_turned_round_are_finite(bench: Bench) -> None:
    node = bench.start(DockNode, dock_backwards=True)
    turned = []
    node._reversal._pub.publish, publish = turned.append, node._reversal._pub.publish
    (hear,) = (it for it in node.subscriptions if it.topic_name == '/cmd_vel_reversed')
    rng = np.random.default_rng(4)
    for _ in range(fuzzing.COUNT):
        hear.callback(fuzzing.wired(fuzzing.anything(hear.msg_type, rng)))
        read.twist(turned[-1])  # raises where it is not finite
    node._reversal._pub.publish = publish
    assert len(turned) == fuzzing.COUNT
