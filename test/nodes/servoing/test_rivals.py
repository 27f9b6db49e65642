"""Who else publishes on cmd_vel is named: at the start, and in the diagnostics of each step."""

from diagnostic_msgs.msg import DiagnosticArray
from geometry_msgs.msg import Twist, TwistStamped
import pytest
import rclpy
from servo_rig import Rig

TEXT = '/teleop_twist_joy may publish on /cmd_vel as well'


@pytest.fixture
def joystick(bench):
    """Return a node that could command the base."""
    node = bench.add(rclpy.create_node('teleop_twist_joy', context=bench.context))
    node.create_publisher(Twist, 'cmd_vel', 1)
    bench.until(lambda: bench.probe.count_publishers('cmd_vel') > 0, 'the joystick')
    return node


def test_another_publisher_is_named_by_the_answer_and_by_the_log(bench, joystick) -> None:
    rig = Rig(bench, autostart=False)
    rig.see()
    answer = bench.call('servo_node/start')
    assert (answer.success, answer.message.startswith(f'started; {TEXT}')) == (True, True)
    bench.until(lambda: bool(bench.logged(TEXT)), 'the log')
    rig.drive()  # it is a warning, no more


def test_the_diagnostics_name_it_in_each_step_and_while_it_stands(bench, joystick) -> None:
    heard = bench.listen(DiagnosticArray, '/diagnostics')
    rig = Rig(bench)
    rig.idle()
    rig.drive()
    rig.run.stop()
    bench.settle()
    assert len(heard) >= 2
    for message in heard[-2:]:
        (status,) = message.status
        assert (status.level, TEXT in status.message) == (b'\x01', True)


def test_one_that_has_gone_is_not_named_any_more(bench, joystick) -> None:
    Rig(bench)
    assert TEXT in bench.call('servo_node/start').message
    bench.nodes.remove(joystick)
    bench.executor.remove_node(joystick)
    joystick.destroy_node()
    bench.until(lambda: TEXT not in bench.call('servo_node/start').message, 'it to go')


def test_of_the_servo_itself_and_of_other_servos_no_notice_is_given(bench) -> None:
    Rig(bench)
    answer = bench.call('servo_node/start')
    assert (answer.success, 'may publish' in answer.message) == (True, False)


@pytest.mark.parametrize('stamped', [False, True])
def test_a_base_that_takes_another_type_is_named_at_the_start(two_processes, stamped) -> None:
    bench, other = two_processes
    other.listen(Twist if stamped else TwistStamped, 'cmd_vel')
    heard = bench.listen(DiagnosticArray, '/diagnostics')
    rig = Rig(bench, autostart=False, enable_stamped_cmd_vel=stamped)
    kinds = ['geometry_msgs/Twist', 'geometry_msgs/TwistStamped'][:: 1 if stamped else -1]
    text = (
        f'/probe takes {kinds[0]} on /cmd_vel, /servo_node publishes {kinds[1]}: no command '
        f'arrives; restart /servo_node with enable_stamped_cmd_vel: {str(not stamped).lower()}'
    )
    rig.see()
    bench.until(lambda: text in bench.call('servo_node/start').message, 'the base')
    rig.drive()
    bench.until(lambda: text in heard[-1].status[0].message, 'diagnostics')
    assert heard[-1].status[0].level == b'\x01'


def test_where_it_starts_by_itself_the_log_names_it(two_processes) -> None:
    bench, other = two_processes
    other.listen(TwistStamped, 'cmd_vel')
    Rig(bench).drive()
    bench.until(lambda: bench.logged('/probe takes geometry_msgs/TwistStamped'), 'the log')
