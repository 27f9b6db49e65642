"""The stop button wins over everything; and who else commands the base is named, or stops it."""

from functools import partial

from diagnostic_msgs.msg import DiagnosticArray
from durations import few_of
from geometry_msgs.msg import Twist, TwistStamped
import pytest
import rclpy
from servo_rig import HandSetClock, Rig
from std_msgs.msg import Bool

from visual_servo_epipolar.core.geometry.motion import STANDSTILL
from visual_servo_epipolar.nodes import commands, qos, watching
from visual_servo_epipolar.nodes.servo_node import ServoNode

TEXT = 'the stop button is pressed; release it, then call ~/start'
LEFTOVER_NS = 25_000_000_000  # as the servo has it: the lease of Fast DDS, and some


class Buttoned(Rig):
    """A servo with a stop button."""

    def __init__(self, bench, **values) -> None:
        self._button = bench.talk(Bool, 'stop_button', qos.LATCHED)
        super().__init__(bench, **values)

    def press(self, *, pressed: bool = True) -> None:
        self._button(Bool(data=pressed))
        self.bench.settle()


@pytest.fixture
def rig(bench) -> Buttoned:
    return Buttoned(bench)


def test_a_pressed_button_stops_the_robot(rig) -> None:
    rig.drive().press()
    assert (rig.phase, rig.twists()[-1]) == ('waiting', STANDSTILL)
    count = len(rig.commands)
    for _ in range(3):
        rig.see()
    assert all(twist == STANDSTILL for twist in rig.twists()[count:])


def test_a_servo_that_is_started_in_mid_press_stands(bench) -> None:
    bench.talk(Bool, 'stop_button', qos.LATCHED)(Bool(data=True))
    rig = Rig(bench)
    bench.settle()
    for _ in range(3):
        rig.see()
    assert rig.commands == [] or rig.twists()[-1] == STANDSTILL
    assert not bench.call('servo_node/start').success


@pytest.mark.parametrize('order', ['start', 'reset', 'stop'])
def test_no_order_moves_the_robot_while_it_is_pressed(rig, order) -> None:
    rig.press()
    answer = rig.bench.call(f'servo_node/{order}')
    assert answer.success == (order != 'start')
    if order == 'start':
        assert answer.message == TEXT
    for _ in range(3):
        rig.see()
    assert all(twist == STANDSTILL for twist in rig.twists())


@pytest.mark.parametrize('order', ['', 'reset'])
def test_released_it_stands_until_it_is_started(rig, order) -> None:
    rig.drive().press()
    rig.press(pressed=False)
    rig.bench.until(lambda: rig.bench.logged('the stop button is released'), 'the log')
    if order:
        rig.bench.call(f'servo_node/{order}')
    count = len(rig.commands)
    rig.see()
    assert all(twist == STANDSTILL for twist in rig.twists()[count:])
    assert rig.bench.call('servo_node/start').success
    rig.drive()


def test_the_diagnostics_warn_while_it_is_pressed(rig) -> None:
    heard = rig.bench.listen(DiagnosticArray, '/diagnostics')
    rig.press()
    rig.bench.until(lambda: bool(heard), 'diagnostics')
    (status,) = heard[-1].status
    assert (status.level, status.message) == (b'\x01', f'waiting: {TEXT}')


def other(bench, name: str):
    words = ['--ros-args', '-r', f'__node:={name}']
    return bench.start(partial(ServoNode, cli_args=words))


def test_of_two_servos_on_one_base_none_is_started(bench) -> None:
    rig = Rig(bench, autostart=False)
    other(bench, 'dock_servo')
    answer = bench.call('servo_node/start')
    assert not answer.success
    assert answer.message.startswith('/dock_servo commands /cmd_vel as well')
    rig.see()
    assert rig.commands == []


def test_no_run_begins_by_itself_beside_another_servo(bench) -> None:
    rig = Rig(bench)
    rival = other(bench, 'dock_servo')
    rig.see()
    assert (rig.phase, rig.commands) == ('waiting', [])
    text = '/dock_servo commands /cmd_vel as well'
    assert bench.call('servo_node/start').message.startswith(text)
    bench.remove(rival)
    bench.until(lambda: bench.call('servo_node/start').success, 'the other to go')
    rig.drive()


def test_where_time_waits_for_the_servo_nobody_looks_for_another(bench) -> None:
    rig = Rig(bench, watchdog=False)
    other(bench, 'dock_servo')
    assert bench.call('servo_node/start').success
    rig.drive()


def test_what_is_left_of_a_servo_that_was_killed_keeps_none_from_starting(bench) -> None:
    rig = Rig(bench)
    other(bench, 'servo_node')
    rig.idle()
    rig.drive()
    text = '/servo_node commands /cmd_vel as well, two servos would fight'
    bench.until(lambda: bool(bench.logged(text)), 'the warning')


def aged_twin(bench, **parameters) -> Rig:
    """Return a rig beside a servo of the same name, which is there for longer than a lease."""
    rig = Rig(bench, **parameters)
    clock = rig.clock = rig.node._live.rivals._steady = HandSetClock()
    other(bench, 'servo_node')
    rig.idle()
    clock.now_ns += LEFTOVER_NS - 1
    return rig


def test_a_second_servo_of_the_same_name_that_stays_ends_the_run(bench) -> None:
    rig = aged_twin(bench)
    rig.idle()
    rig.drive()
    rig.clock.now_ns += 1
    rig.idle()
    bench.until(lambda: rig.twists()[-1] == STANDSTILL, 'the zero twist')
    count = len(rig.commands)
    rig.see()
    assert rig.phase == 'waiting'
    assert all(twist == STANDSTILL for twist in rig.twists()[count:])


def test_beside_it_no_run_begins(bench) -> None:
    rig = aged_twin(bench, autostart=False)
    rig.clock.now_ns += 1
    answer = bench.call('servo_node/start')
    assert answer.message.startswith('/servo_node commands /cmd_vel as well')
    assert not answer.success
    rig.clock.now_ns -= 1
    assert '/servo_node commands' not in bench.call('servo_node/start').message


def test_a_twin_that_has_gone_does_not_count_for_the_next(bench, monkeypatch) -> None:
    looks = commands.CommandConflicts(bench.probe)
    clock = looks._steady = HandSetClock()
    for names in (['/probe'], [], ['/probe']):
        monkeypatch.setattr(commands, '_rivals', lambda node, names=names: names)
        assert looks.refusal() == ''
        clock.now_ns += LEFTOVER_NS
    assert looks.refusal().startswith('/probe commands /cmd_vel as well')


def button_of(rig) -> watching.StopButton:
    """Return the button as the servo knows it, whatever its topics say yet."""
    return rig.node._stop_button


VOLATILE = qos.STREAM
SECOND_S = 0.3  # of patience in these tests


@pytest.fixture
def hasty(monkeypatch) -> None:
    monkeypatch.setattr(watching, 'RELEASE_S', SECOND_S)


def asked(rig) -> None:
    """Wait until a doubtful release has been decided on."""
    button = button_of(rig)
    rig.bench.until(lambda: button._asking is None, 'the decision on the release')
    rig.bench.settle()


@pytest.mark.parametrize(
    'second', few_of([qos.LATCHED, VOLATILE], keep=(1,)), ids=['latched', 'repeated']
)
@pytest.mark.parametrize('first', [qos.LATCHED, VOLATILE], ids=['latched', 'repeated'])
def test_a_second_button_does_not_release_the_first(bench, hasty, first, second) -> None:
    rig = Rig(bench)
    press, other = (bench.talk(Bool, 'stop_button', profile) for profile in (first, second))
    bench.until(lambda: rig.node.count_publishers('stop_button') == 2, 'both buttons')
    rig.drive()
    press(Bool(data=True))
    bench.until(lambda: button_of(rig).pressed, 'the press')
    for _ in range(4):
        other(Bool(data=False))
        if first is VOLATILE:
            press(Bool(data=True))  # again, as it does
        bench.settle()
        asked(rig)
    assert button_of(rig).pressed
    answer = bench.call('servo_node/start')
    assert (answer.success, answer.message) == (False, TEXT)
    press(Bool(data=False))
    other(Bool(data=False))
    bench.until(lambda: not button_of(rig).pressed, 'the release of the first')
    assert bench.call('servo_node/start').success


@pytest.mark.parametrize('profile', [qos.LATCHED, VOLATILE], ids=['latched', 'repeated'])
def test_a_press_is_not_lost_by_a_false_of_another_button_after_it(bench, profile) -> None:
    rig = Rig(bench)
    press, other = (bench.talk(Bool, 'stop_button', profile) for _ in range(2))
    bench.until(lambda: rig.node.count_publishers('stop_button') == 2, 'both buttons')
    rig.drive()
    press(Bool(data=True))
    other(Bool(data=False))
    bench.until(lambda: rig.phase == 'waiting', 'the robot to be stopped')


def test_after_a_release_in_doubt_nothing_is_left_over(bench, hasty) -> None:
    rig = Rig(bench)
    press, other = (bench.talk(Bool, 'stop_button', qos.LATCHED) for _ in range(2))
    bench.until(lambda: rig.node.count_publishers('stop_button') == 2, 'both buttons')
    before = len(list(rig.node.subscriptions)), len(list(rig.node.timers))
    for pressed in (True, False):
        press(Bool(data=pressed))
        bench.until(lambda pressed=pressed: button_of(rig).pressed == pressed, 'a word')
        other(Bool(data=False))
        bench.settle()
        asked(rig)
    assert (len(list(rig.node.subscriptions)), len(list(rig.node.timers))) == before


MAY_PUBLISH = '/teleop_twist_joy may publish on /cmd_vel as well'


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
    assert (answer.success, answer.message.startswith(f'started; {MAY_PUBLISH}')) == (True, True)
    bench.until(lambda: bool(bench.logged(MAY_PUBLISH)), 'the log')
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
        assert (status.level, MAY_PUBLISH in status.message) == (b'\x01', True)


def test_one_that_has_gone_is_not_named_any_more(bench, joystick) -> None:
    Rig(bench)
    assert MAY_PUBLISH in bench.call('servo_node/start').message
    bench.remove(joystick)
    bench.until(lambda: MAY_PUBLISH not in bench.call('servo_node/start').message, 'it to go')


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
