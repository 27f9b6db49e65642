"""Whatever comes on any subscription of the other nodes: they live, say one line, stay small."""

from bench import Bench
import fuzzing
import numpy as np
import pytest

from visual_servo_epipolar.messages import read
from visual_servo_epipolar.nodes.camera_node import CameraNode
from visual_servo_epipolar.nodes.dock_node import DockNode
from visual_servo_epipolar.nodes.unicycle_node import UnicycleNode

SMALL = {'width': 64, 'height': 48, 'focal_length': 38.0, 'principal_u': 31.5}
SMALL['principal_v'] = 23.5
KINDS = [
    pytest.param(DockNode, {}, id='dock'),
    pytest.param(DockNode, {'autostart_node': False}, id='dock that is not active'),
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


@pytest.mark.parametrize(('kind', 'values'), KINDS)
def test_a_node_outlives_all_that_it_hears(bench: Bench, kind, values) -> None:
    node = bench.start(kind, **values)

    def run(count: int) -> float:
        rng = np.random.default_rng(2)
        for number in range(count):
            fuzzing.sent_to(node, rng)
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
        fuzzing.sent_to(node, rng)
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
