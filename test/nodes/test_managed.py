"""Managed nodes: what they do in which state, and requests that would end any node of rclpy."""

from collections.abc import Callable
from typing import Any

from lifecycles import (
    assert_cycles_leave_nothing,
    assert_gone_at_once,
    change,
    entities,
    go,
    IDS,
)
import pytest
from rcl_interfaces.msg import Parameter, ParameterValue
from rcl_interfaces.srv import SetParameters, SetParametersAtomically
from rclpy.parameter import Parameter as Change
from rosgraph_msgs.msg import Clock
from servo_rig import Rig
from std_msgs.msg import String
from std_srvs.srv import Trigger

from visual_servo_epipolar.messages import write
from visual_servo_epipolar.nodes import parameters, qos
from visual_servo_epipolar.nodes.managed import in_every_state, ManagedNode, serve
from visual_servo_epipolar.nodes.reports import Complaints
from visual_servo_epipolar.nodes.startup.settings import LifecycleSettings
from visual_servo_epipolar.nodes.unicycle_node import UnicycleNode

PERIOD_S = 0.01


class Parrot(ManagedNode):
    """Repeats what it hears, ticks, and says in which part of its life it is."""

    def __init__(self, **options: Any) -> None:
        super().__init__('parrot', **options)
        self.fails: dict[str, Exception] = {}
        self.calls: list[str] = []
        self.heard: list[str] = []
        self.ticks = 0
        self.later: Any = None
        serve(self, '~/talk', lambda: 'hello')
        serve(self, '~/hush', in_every_state(lambda: 'silent'))
        self.autostart(parameters.declare(self, LifecycleSettings))

    def configure(self) -> None:
        self.words = self.create_publisher(String, 'words', 10)
        self.mood = self.create_publisher(String, 'mood', qos.LATCHED)
        self.create_subscription(String, 'said', self._hear, qos.STREAM)
        self.create_subscription(String, 'name', self._hear_name, qos.LATCHED)
        self.create_timer(PERIOD_S, self._on_tick)
        self.create_client(Trigger, 'nobody')
        self._live('configure')

    def activate(self) -> None:
        self._live('activate')
        for _ in range(2):  # the first is replaced in mid-life
            more = self.create_subscription(String, 'more', self._hear, qos.STREAM)
            if self.later is not None:
                self.destroy_subscription(self.later)
            self.later = more

    def deactivate(self) -> None:
        self._live('deactivate')

    def cleanup(self) -> None:
        self.later = None
        self._live('cleanup')

    def _live(self, part: str) -> None:
        self.calls.append(part)
        self.mood.publish(write.text(part))
        self.words.publish(write.text(part))
        if part in self.fails:
            raise self.fails[part]

    def _hear(self, message: String) -> None:
        self.heard.append(message.data)
        self.words.publish(message)

    @in_every_state
    def _hear_name(self, message: String) -> None:
        self._hear(message)

    def _on_tick(self) -> None:
        self.ticks += 1


@pytest.fixture
def parrot(bench) -> Callable[..., Parrot]:
    """Return how to start one, unconfigured unless ``autostart_node``."""

    def start(*, autostart_node: bool = False, **values: Any) -> Parrot:
        node: Parrot = bench.start(Parrot, autostart_node=autostart_node, **values)
        return node

    return start


def words(heard: list[String]) -> list[str]:
    return [message.data for message in heard]


def test_services_answer_what_to_do_but_for_those_of_every_state(bench, parrot) -> None:
    node = parrot()
    assert (node.state, node.calls) == ('unconfigured', [])
    expected = (
        'autostart_node is false: /parrot is unconfigured; '
        'call ros2 lifecycle set /parrot configure, then activate'
    )
    bench.until(lambda: bench.logged(expected), 'what to do in the log')
    for state, way in (('unconfigured', 'configure, then activate'), ('inactive', 'activate')):
        answer, text = bench.call('parrot/talk'), f'call ros2 lifecycle set /parrot {way}'
        assert (answer.success, answer.message) == (False, f'/parrot is {state}; {text}')
        assert bench.call('parrot/hush').message == 'silent'
        go(bench, node, *['configure'][: state == 'unconfigured'])
    go(bench, node, 'activate')
    assert bench.call('parrot/talk').message == 'hello'
    assert bench.call('parrot/hush').message == 'silent'


def test_inactive_is_silent_and_deaf(bench, parrot) -> None:
    say, heard = bench.talk(String, 'said'), bench.listen(String, 'words')
    node = parrot()
    go(bench, node, 'configure')
    say(write.text('to nobody'))
    bench.settle()
    assert (node.heard, node.ticks, words(heard)) == ([], 0, [])
    go(bench, node, 'activate')
    say(write.text('hello'))
    bench.until(lambda: node.heard == ['hello'] and node.ticks > 0, 'an active node to hear')
    go(bench, node, 'deactivate')
    ticks = node.ticks
    say(write.text('to nobody'))
    bench.settle()
    assert (node.heard, node.ticks) == (['hello'], ticks)


def test_the_last_words_of_an_active_node_are_heard(bench, parrot) -> None:
    heard = bench.listen(String, 'words')
    node = parrot()
    go(bench, node, 'configure', 'activate', 'deactivate', 'cleanup')
    bench.settle()
    assert words(heard) == ['activate', 'deactivate']


def test_what_is_latched_is_heard_in_every_state_if_marked_and_anew_when_configured_anew(
    bench, parrot
) -> None:
    name = bench.talk(String, 'name', qos.LATCHED)
    node = parrot()
    go(bench, node, 'configure')
    name(write.text('Polly'))
    bench.until(lambda: node.heard == ['Polly'], 'its name')
    go(bench, node, 'activate', 'deactivate', 'cleanup', 'configure')
    bench.until(lambda: node.heard == ['Polly', 'Polly'], 'its name again')


@pytest.mark.parametrize('early', [True, False])
def test_simulated_time_goes_on_while_a_node_is_inactive_and_after(bench, parrot, early) -> None:
    tick = bench.talk(Clock, '/clock', qos.CLOCK)
    node = parrot(use_sim_time=early)
    go(bench, node, 'configure')
    node.set_parameters([parameters.override('use_sim_time', True)])
    bench.until(lambda: any(item.topic_name == '/clock' for item in node.subscriptions), 'a clock')

    def came(time_ns: int) -> bool:
        tick(write.clock(time_ns))
        return bool(node.get_clock().now().nanoseconds == time_ns)

    bench.until(lambda: came(5_000_000_000), 'the time')
    go(bench, node, 'cleanup', 'configure')
    bench.until(lambda: came(6_000_000_000), 'the time after a cleanup')


def test_what_others_take_care_of_outlives_a_cleanup(bench, parrot) -> None:
    node = parrot(autostart_node=True)
    node.keep(node.create_timer(1.0, lambda: None))
    bench.call('parrot/talk')
    go(bench, node, 'deactivate', 'cleanup')
    assert len(list(node.timers)) == 1


@pytest.mark.parametrize('number', [IDS['activate'], IDS['configure'], 5, 10, 99, 255])
def test_an_impossible_transition_is_refused_and_the_node_lives_on(bench, parrot, number) -> None:
    node = parrot(autostart_node=True)
    assert not change(bench, node, number)
    assert node.state == 'active'
    expected = f'/parrot is active: there is no transition with the id {number}'
    bench.until(lambda: bench.logged(expected), 'what was wrong in the log')
    assert go(bench, node, 'deactivate') == 'inactive'


@pytest.mark.parametrize('part', ['configure', 'activate'])
def test_a_refusal_is_one_line_and_leaves_the_node_as_it_was(bench, parrot, part) -> None:
    node = parrot()
    before = entities(node)
    go(bench, node, *['configure'][: part == 'activate'])
    state, between = node.state, entities(node)
    node.fails = {part: OSError('the disk is full')}
    assert not change(bench, node, IDS[part])
    assert (node.state, entities(node)) == (state, between)
    assert part == 'configure' or not node.words.is_activated
    bench.until(lambda: bench.logged(f'{part} failed: the disk is full'), 'the reason in the log')
    assert not bench.logged('Traceback')
    node.fails = {}
    assert go(bench, node, *IDS.keys() & {part}) != state
    go(bench, node, *['deactivate'][: part == 'activate'], 'cleanup')
    assert entities(node) == before


WAYS = {'configure': 0, 'activate': 1, 'deactivate': 2, 'cleanup': 1}  # steps before a part
MISTAKE, REFUSAL = KeyError('a mistake'), OSError('not now')


@pytest.mark.parametrize(
    ('part', 'error', 'text'),
    [
        *((part, MISTAKE, 'Traceback') for part in WAYS),
        *((part, REFUSAL, 'not now') for part in ('deactivate', 'cleanup')),
    ],
)
def test_after_a_mistake_the_node_can_be_had_again(bench, parrot, part, error, text) -> None:
    node = parrot()
    before = entities(node)
    go(bench, node, *['configure', 'activate'][: WAYS[part]])
    node.fails = {part: error}
    assert not change(bench, node, IDS[part])
    assert (node.state, entities(node)) == ('unconfigured', before)
    bench.until(lambda: bench.logged(f'{part} failed: {text}'), 'the mistake in the log')
    assert str(error) in bench.logged(f'{part} failed: ')[0]
    node.fails = {}
    assert go(bench, node, 'configure', 'activate') == 'active'


@pytest.mark.parametrize('part', ['deactivate', 'cleanup'])
def test_nothing_keeps_a_node_from_its_end(bench, parrot, part) -> None:
    node = parrot(autostart_node=True)
    node.fails = {part: OSError('not now')}
    assert change(bench, node, label='shutdown')
    assert node.state == 'finalized'
    assert node.calls[2:] == ['deactivate', 'cleanup']
    assert bench.call('parrot/talk').message == '/parrot is finalized; start it anew'


@pytest.mark.parametrize('error', [OSError('the disk is full'), KeyError('a mistake')])
def test_what_keeps_a_node_from_starting_is_raised(bench, parrot, monkeypatch, error) -> None:
    def fail(self: ManagedNode) -> None:
        raise error

    kind = type(parrot())
    monkeypatch.setattr(kind, 'activate', fail)
    with pytest.raises(type(error)) as raised:
        bench.start(kind)
    assert raised.value is error
    bench.settle()
    assert not bench.logged('failed')  # once is enough: run.py says it
    assert bench.probe.get_node_names().count('parrot') == 1  # the first one


def test_configured_and_cleaned_up_again_and_again_it_leaves_nothing(bench, parrot) -> None:
    assert_cycles_leave_nothing(bench, parrot())
    bench.until(lambda: not bench.probe.count_publishers('/words'), 'its topics to be gone')


def test_a_node_that_is_destroyed_is_gone_at_once(bench, parrot) -> None:
    node = parrot(autostart_node=True)
    assert_gone_at_once(bench, node)
    node.destroy_node()  # a second time is nothing
    assert node.state == 'finalized'


@pytest.mark.parametrize('way', [(), ('configure',), ('configure', 'activate')])
def test_the_end_comes_from_every_state_and_once(bench, parrot, way) -> None:
    node = parrot()
    before = entities(node)
    go(bench, node, *way)
    assert change(bench, node, label='shutdown')
    assert (node.state, entities(node)) == ('finalized', before)
    assert not change(bench, node, label='shutdown')
    assert not change(bench, node, 1)


def of_type(number: int) -> Parameter:
    return Parameter(name='max_linear', value=ParameterValue(type=number, double_value=0.1))


@pytest.mark.parametrize('number', [10, 255])
def test_a_parameter_of_no_type_is_refused(bench, number) -> None:
    rig = Rig(bench, stale_timeout=5.0).drive()  # also where the machine stands still
    many = [of_type(3), of_type(number)]
    for kind, name in (
        (SetParameters, 'set_parameters'),
        (SetParametersAtomically, 'set_parameters_atomically'),
    ):
        answer = bench.call(f'servo_node/{name}', kind, kind.Request(parameters=many))
        results = answer.results if kind is SetParameters else [answer.result]
        assert not any(item.successful for item in results)
        text = f"'max_linear' must have a type from 0 to 9, got {number}"
        assert {item.reason for item in results} == {text}
    rig.drive()


@pytest.mark.parametrize('from_the_start', [True, False])
def test_a_clock_below_zero_is_left_out(bench, from_the_start) -> None:
    tick = bench.talk(Clock, '/clock', qos.CLOCK)
    node = bench.start(UnicycleNode, use_sim_time=from_the_start)
    node.set_parameters([Change('use_sim_time', value=True)])
    bench.settle()
    for seconds in (5, -1, 6, -(2**31)):
        tick(write.clock(seconds * 1_000_000_000))
        bench.settle()
    assert node.get_clock().now().nanoseconds == 6_000_000_000
    bench.until(lambda: bool(bench.logged('/clock is below 0, it is left out')), 'what is wrong')


REPEATED = ['3 of nan, 12 needed', 'too dark', '7.5 of 1e-3, 12 needed', 'too dark']


@pytest.mark.parametrize(('period_s', 'logged'), [(60.0, REPEATED[:2]), (0.0, REPEATED)])
def test_a_complaint_hides_its_repetitions_for_a_while_and_no_other(
    bench, period_s, logged
) -> None:
    complain = Complaints(bench.probe, period_s)
    for text in REPEATED:
        complain(text)
    bench.until(lambda: len(bench.logged('')) >= len(logged), 'the complaints')
    bench.settle()
    assert bench.logged('') == logged
