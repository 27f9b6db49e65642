"""Commands turned round for a base that docks backward."""

from bench import Bench
from geometry_msgs.msg import Twist as TwistMessage
from geometry_msgs.msg import TwistStamped
import pytest

from visual_servo_epipolar.core.geometry.motion import STANDSTILL, Twist
from visual_servo_epipolar.messages import read, write
from visual_servo_epipolar.nodes.dock_node import DockNode

AHEAD, BACK = Twist(0.3, 0.2), Twist(-0.3, 0.2)
STAMP_NS = 5_000_000_007


def test_a_stamped_command_keeps_its_stamp(bench: Bench) -> None:
    heard = bench.listen(TwistStamped, 'cmd_vel')
    command = bench.talk(TwistStamped, 'cmd_vel_reversed')
    bench.start(DockNode, dock_backwards=True, enable_stamped_cmd_vel=True)
    command(write.twist_stamped(AHEAD, STAMP_NS, 'base_link'))
    bench.until(lambda: bool(heard), 'the command, turned round')
    assert (read.twist(heard[0]), read.stamp_ns(heard[0].header)) == (BACK, STAMP_NS)


@pytest.mark.parametrize('stamped', [False, True])
def test_at_a_broken_command_and_at_its_end_the_base_stands(bench: Bench, stamped: bool) -> None:
    kind = TwistStamped if stamped else TwistMessage
    heard, command = bench.listen(kind, 'cmd_vel'), bench.talk(kind, 'cmd_vel_reversed')
    node = bench.start(DockNode, dock_backwards=True, enable_stamped_cmd_vel=stamped)
    broken = kind()
    (broken.twist if stamped else broken).linear.x = float('nan')
    command(broken)
    bench.until(lambda: len(heard) == 1, 'a command in place of the broken one')
    node.stop()
    bench.until(lambda: len(heard) == 2, 'the last command')
    assert [read.twist(message) for message in heard] == [STANDSTILL, STANDSTILL]
    bench.until(lambda: bool(bench.logged('nan')), 'what was wrong with it')
