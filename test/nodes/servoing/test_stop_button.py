"""The stop button wins over everything; beside another servo none begins a run."""

from functools import partial

from durations import few_of
import pytest
from servo_rig import Rig
from std_msgs.msg import Bool

from visual_servo_epipolar.nodes import qos, watching
from visual_servo_epipolar.nodes.servo_node import ServoNode

TEXT = 'the stop button is pressed; release it, then call ~/start'


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


def test_a_servo_that_is_started_in_mid_press_stands(bench) -> None:
    bench.talk(Bool, 'stop_button', qos.LATCHED)(Bool(data=True))
    rig = Rig(bench)
    bench.until(lambda: bench.logged('the stop button is pressed'), 'the button to be heard')
    rig.stand()
    assert not bench.call('servo_node/start').success


@pytest.mark.parametrize('order', ['start', 'reset', 'stop'])
def test_no_order_moves_the_robot_while_it_is_pressed(rig, order) -> None:
    rig.press()
    answer = rig.bench.call(f'servo_node/{order}')
    assert answer.success == (order != 'start')
    if order == 'start':
        assert answer.message == TEXT
    rig.stand()


@pytest.mark.parametrize('order', ['', 'reset'])
def test_released_it_stands_until_it_is_started(rig, order) -> None:
    rig.drive().press()
    rig.press(pressed=False)
    rig.bench.until(lambda: rig.bench.logged('the stop button is released'), 'the log')
    if order:
        rig.bench.call(f'servo_node/{order}')
    rig.stand()
    assert rig.bench.call('servo_node/start').success
    rig.drive()


def test_the_diagnostics_warn_while_it_is_pressed(rig) -> None:
    rig.press()
    (status,) = rig.reports[-1].status
    assert (status.level, status.message) == (b'\x01', f'waiting: {TEXT}')


def other(bench, name: str):
    words = ['--ros-args', '-r', f'__node:={name}']
    return bench.start(partial(ServoNode, cli_args=words))


@pytest.mark.parametrize('name', ['dock_servo', 'servo_node'], ids=['another', 'of the same name'])
def test_no_run_begins_beside_another_servo(bench, name) -> None:
    rig = Rig(bench)
    rival = other(bench, name)
    for _ in range(3):
        rig.see()
    assert (rig.phase, rig.commands) == ('waiting', [])
    if name == 'dock_servo':  # of two that share a name either may answer
        answer = bench.call('servo_node/start')
        assert not answer.success
        assert answer.message.startswith('/dock_servo commands /cmd_vel as well')
    bench.remove(rival)
    bench.until(
        lambda: bench.probe.get_node_names().count(name) == (name == 'servo_node'), 'it to go'
    )
    assert bench.call('servo_node/start').success
    rig.drive()


def test_where_time_waits_for_the_servo_no_other_is_looked_for(bench) -> None:
    rig = Rig(bench, watchdog=False)
    other(bench, 'dock_servo')
    assert bench.call('servo_node/start').success
    rig.drive()


def test_one_that_comes_in_mid_run_is_warned_of(bench) -> None:
    rig = Rig(bench).drive()
    other(bench, 'dock_servo')
    rig.idle()
    text = '/dock_servo commands /cmd_vel as well, two servos would fight'
    bench.until(lambda: bool(bench.logged(text)), 'the warning')


VOLATILE = qos.STREAM
RELEASE_S = 0.3  # in these tests


class Pair(Rig):
    """A servo that drives, beside two stop buttons: ``press`` and ``other``."""

    def __init__(self, bench, first=qos.LATCHED, second=qos.LATCHED) -> None:
        super().__init__(bench)
        self.press, self.other = (bench.talk(Bool, 'stop_button', it) for it in (first, second))
        bench.until(lambda: self.node.count_publishers('stop_button') == 2, 'both buttons')
        self.drive()
        self.before = self.entities()

    def entities(self) -> tuple[int, int]:
        return len(list(self.node.subscriptions)), len(list(self.node.timers))

    def decided(self) -> None:
        """Wait until a doubtful release has been decided on, which takes entities of its own."""
        self.bench.settle()
        self.bench.until(lambda: self.entities() == self.before, 'the decision on the release')
        self.bench.settle()


@pytest.fixture
def hasty(monkeypatch) -> None:
    monkeypatch.setattr(watching, 'RELEASE_S', RELEASE_S)


@pytest.mark.parametrize(
    'second', few_of([qos.LATCHED, VOLATILE], keep=(1,)), ids=['latched', 'repeated']
)
@pytest.mark.parametrize('first', [qos.LATCHED, VOLATILE], ids=['latched', 'repeated'])
def test_a_second_button_does_not_release_the_first(bench, hasty, first, second) -> None:
    rig = Pair(bench, first, second)
    rig.press(Bool(data=True))
    for _ in range(4):
        rig.other(Bool(data=False))
        if first is VOLATILE:
            rig.press(Bool(data=True))  # again, as it does
        rig.decided()
    answer = bench.call('servo_node/start')
    assert (answer.success, answer.message) == (False, TEXT)
    rig.press(Bool(data=False))
    rig.other(Bool(data=False))
    bench.until(lambda: bench.logged('the stop button is released'), 'the release of the first')
    assert bench.call('servo_node/start').success


@pytest.mark.parametrize('profile', [qos.LATCHED, VOLATILE], ids=['latched', 'repeated'])
def test_a_press_is_not_lost_by_a_false_of_another_button_after_it(bench, profile) -> None:
    rig = Pair(bench, profile, profile)
    rig.press(Bool(data=True))
    rig.other(Bool(data=False))
    bench.until(lambda: rig.phase == 'waiting', 'the robot to be stopped')
