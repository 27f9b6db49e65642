"""The recorder node: what is published lies in the bag, whatever state the node is led to."""

from functools import partial
import sys

from bag_reading import files_of_at_most, read_back, size_of, texts_in
from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus
from lifecycles import change, entities, go, led
import pytest
from rosbags.highlevel import AnyReader
from rosbags.interfaces import QosDurability, QosReliability, QosTime
from rosgraph_msgs.msg import Clock
from sensor_msgs.msg import JointState
from std_msgs.msg import String

from visual_servo_epipolar.core.errors import InputError
from visual_servo_epipolar.core.servo.state import ServoState
from visual_servo_epipolar.messages import diagnostics, read, write
from visual_servo_epipolar.messages.diagnostics import Words
from visual_servo_epipolar.nodes import parameters, qos, recorder_node
from visual_servo_epipolar.nodes.lockstep import ObserverNode, UNFINISHED
from visual_servo_epipolar.nodes.raw_subscriptions import DEPTH, message_class, RawSubscriptions
from visual_servo_epipolar.nodes.recorder_node import RecorderNode
from visual_servo_epipolar.simulation.closed_loop import RunMonitor

BEST_EFFORT = qos.ODOMETRY


class Recording:
    """A running recorder, and words to record."""

    def __init__(self, bench, folder, **values) -> None:
        self.bench, self.bag = bench, folder / 'bag'
        self.node = bench.start(RecorderNode, bag=str(self.bag), **values)

    @property
    def topics(self) -> set[str]:
        return {item.topic_name for item in self.node.subscriptions if item.raw}

    def until_recorded(self, *topics: str) -> None:
        self.bench.until(lambda: set(topics) <= self.topics, f'{topics} to be recorded')

    def until_written(self, topic: str, count: int = 1) -> None:
        self.bench.until(
            lambda: self.node.status().written.get(topic, 0) >= count,
            f'{count} messages of {topic} to be written',
        )

    def bags(self) -> list[str]:
        return sorted(path.name for path in self.bag.parent.iterdir())


def test_everything_published_is_in_the_bag(bench, tmp_path) -> None:
    say, late = bench.talk(String, 'words'), bench.talk(String, 'state', qos.LATCHED)
    late(write.text('before anybody listened'))
    recording = Recording(bench, tmp_path)
    recording.until_recorded('/words', '/state', '/diagnostics')
    for number in range(50):
        say(write.text(str(number)))
    recording.until_written('/words', 50)
    recording.until_written('/state')
    recording.node.stop()
    assert texts_in(recording.bag) == [str(number) for number in range(50)]
    assert texts_in(recording.bag, '/state') == ['before anybody listened']


def test_hash_and_qos_are_those_of_the_publishers(bench, tmp_path) -> None:
    bench.talk(String, 'state', qos.LATCHED)
    bench.talk(JointState, 'numbers', BEST_EFFORT)
    recording = Recording(bench, tmp_path, topics=('state', 'numbers'))
    recording.until_recorded('/state', '/numbers')
    type_hash = bench.probe.get_publishers_info_by_topic('/numbers')[0].topic_type_hash
    recording.node.stop()
    with AnyReader([recording.bag]) as reader:
        connections = {item.topic: item for item in reader.connections}
    (state,) = connections['/state'].ext.offered_qos_profiles
    (numbers,) = connections['/numbers'].ext.offered_qos_profiles
    reliable, best_effort = QosReliability.RELIABLE, QosReliability.BEST_EFFORT
    assert (state.reliability, state.durability) == (reliable, QosDurability.TRANSIENT_LOCAL)
    assert (numbers.reliability, numbers.durability) == (best_effort, QosDurability.VOLATILE)
    assert state.deadline == state.lifespan == QosTime(sec=9223372036, nsec=854775807)  # for ever
    assert connections['/numbers'].digest == str(type_hash)
    assert 'MSG: std_msgs/Header' in connections['/numbers'].msgdef.data


def test_only_what_is_wanted_is_recorded(bench, tmp_path) -> None:
    for name in ('words', 'left/image_raw', 'left/overlay/image_raw', 'right/image_raw'):
        bench.talk(String, name)
    recording = Recording(bench, tmp_path, topics=('/left*', 'words'), exclude=('*overlay*',))
    recording.until_recorded('/words', '/left/image_raw')
    assert recording.topics == {'/words', '/left/image_raw'}
    assert recording.node.ready


def test_a_topic_that_comes_late_is_recorded_from_then_on(bench, tmp_path) -> None:
    diagnostics = bench.listen(DiagnosticArray, '/diagnostics')
    recording = Recording(bench, tmp_path, topics=('words',))
    assert not recording.node.ready
    bench.until(lambda: bool(diagnostics), 'a report')
    assert read.diagnosis(diagnostics[-1])['not_published'] == '/words'
    say = bench.talk(String, 'words')
    recording.until_recorded('/words')
    say(write.text('late'))
    recording.until_written('/words')
    recording.node.stop()
    assert texts_in(recording.bag) == ['late']


def test_a_publisher_that_offers_less_is_heard_as_well(bench, tmp_path) -> None:
    bench.talk(String, 'words')
    recording = Recording(bench, tmp_path, topics=('words',))
    recording.until_recorded('/words')
    weak = bench.probe.create_publisher(String, 'words', BEST_EFFORT)
    bench.until(weak.get_subscription_count, 'the recorder to take what is offered')
    weak.publish(write.text('best effort'))
    recording.until_written('/words')
    recording.node.stop()
    assert texts_in(recording.bag) == ['best effort']


def test_messages_carry_simulated_time(bench, tmp_path) -> None:
    tick, say = bench.talk(Clock, '/clock', qos.CLOCK), bench.talk(String, 'words')
    recording = Recording(bench, tmp_path, topics=('words',), use_sim_time=True)
    recording.until_recorded('/words')
    tick(write.clock(1_500_000_000))
    now = recording.node.get_clock().now
    bench.until(lambda: now().nanoseconds == 1_500_000_000, 'the clock to arrive')
    say(write.text('then'))
    recording.until_written('/words')
    recording.node.stop()
    assert [stamp_ns for _, stamp_ns, _ in read_back(recording.bag)] == [1_500_000_000]


def test_start_and_stop_make_one_bag_after_the_other(bench, tmp_path) -> None:
    say = bench.talk(String, 'words')
    recording = Recording(bench, tmp_path, topics=('words',), autostart=False)
    assert recording.bags() == []
    bench.until(lambda: bench.logged('waits for /recorder_node/start'), 'what to do in the log')
    recording.bag.mkdir()
    answer = bench.call('recorder_node/start')
    assert (answer.success, 'exists already' in answer.message) == (False, True)
    recording.bag.rmdir()
    for number in range(2):
        answer = bench.call('recorder_node/start')
        assert (answer.success, answer.message.split()[:2]) == (True, ['recording', 'to'])
        assert not bench.call('recorder_node/start').success
        recording.until_recorded('/words')
        say(write.text(str(number)))
        recording.until_written('/words')
        answer = bench.call('recorder_node/stop')
        assert (answer.success, answer.message.split()[:3]) == (True, ['1', 'messages', 'in'])
        say(write.text('to no bag'))
    assert not bench.call('recorder_node/stop').success
    assert recording.bags() == ['bag', 'bag_1']
    said = [texts_in(tmp_path / name) for name in recording.bags()]
    assert said == [['0'], ['1']]


def test_a_disk_that_ends_is_one_error(bench, tmp_path) -> None:
    say, heard = bench.talk(String, 'words'), bench.listen(DiagnosticArray, '/diagnostics')
    recording = Recording(bench, tmp_path, topics=('words',), flush_period=0.05)
    recording.until_recorded('/words')
    empty = size_of(recording.bag)
    say(write.text('before'))
    bench.until(lambda: size_of(recording.bag) > empty, 'the first message to be flushed')
    with files_of_at_most(100_000):
        say(write.text('x' * 200_000))
        bench.until(lambda: '/words' not in recording.topics, 'the recording to end')

    def errors() -> list[str]:
        statuses = [message.status[0] for message in heard]
        return [item.message for item in statuses if item.level == DiagnosticStatus.ERROR]

    bench.until(errors, 'an error in the diagnostics')
    bench.until(lambda: bench.logged('recording ended'), 'an error to be logged')
    bench.settle()
    assert len(bench.logged('recording ended')) == 1
    assert 'bag so far is whole' in errors()[0]
    assert texts_in(recording.bag) == ['before']
    assert bench.call('recorder_node/start').success  # into the next bag


@pytest.mark.parametrize('name', ['clock', '/clock'])
def test_a_clock_that_is_not_published_is_not_missed(bench, tmp_path, monkeypatch, name) -> None:
    monkeypatch.setattr(recorder_node, 'PATIENCE_S', 0.0)
    node = bench.add(
        RecorderNode(
            context=bench.context,
            namespace='robot1',
            parameter_overrides=[
                parameters.override('bag', str(tmp_path / 'bag')),
                parameters.override('topics', (name, 'words')),
            ],
        )
    )
    bench.until(lambda: bench.logged('waits for /robot1/words (0 publishers)'), 'the other one')
    assert not [text for text in bench.logged('waits for') if '/clock' in text]
    bench.talk(Clock, '/clock', qos.CLOCK)
    recorded = lambda: {item.topic_name for item in node.subscriptions if item.raw}  # noqa: E731
    bench.until(lambda: recorded() == {'/clock'}, 'the clock to be recorded')


def test_the_diagnostics_are_sentences(bench, tmp_path, monkeypatch) -> None:
    diagnostics = bench.listen(DiagnosticArray, '/diagnostics')
    bench.start(RecorderNode, bag=str(tmp_path / 'bag'), autostart=False)
    said = lambda: diagnostics[-1].status[0].message if diagnostics else ''  # noqa: E731
    bench.until(lambda: said() == 'nothing is being recorded', 'that nothing is')
    assert bench.call('recorder_node/start').success
    bench.until(lambda: said() == f'recording to {tmp_path / "bag"}', 'where to')
    monkeypatch.setitem(sys.modules, 'sensor_msgs.msg', None)  # as if it were not installed
    bench.talk(JointState, 'odd')
    bench.until(
        lambda: '/odd is not recorded: sensor_msgs/msg/JointState cannot be' in said(), 'why'
    )
    assert diagnostics[-1].status[0].level == DiagnosticStatus.WARN


def test_what_a_slow_disk_drops_is_reported_by_topic(bench, tmp_path) -> None:
    diagnostics = bench.listen(DiagnosticArray, '/diagnostics')
    say = bench.talk(String, 'words')
    recording = Recording(bench, tmp_path, topics=('words',), queue_size=0.001)
    recording.until_recorded('/words')
    big = write.text('x' * 3_000_000)

    def dropped() -> int:
        say(big)
        reports = [read.diagnosis(message) for message in diagnostics]
        return int(reports[-1]['dropped']) if reports else 0

    bench.until(lambda: bool(dropped()), 'a message to be dropped')
    count, _, topic = read.diagnosis(diagnostics[-1])['dropped_of'].partition(' of ')
    assert (int(count) > 0, topic) == (True, '/words')
    status = diagnostics[-1].status[0]
    assert status.level == DiagnosticStatus.WARN
    assert f'the disk does not keep up, dropped: {count} of /words' in status.message
    bench.until(lambda: bench.logged('the disk does not keep up'), 'a warning')


def test_what_is_lost_on_the_way_is_reported_by_topic(bench, tmp_path) -> None:
    diagnostics = bench.listen(DiagnosticArray, '/diagnostics')
    say = bench.talk(String, 'words', BEST_EFFORT)
    recording = Recording(bench, tmp_path, topics=('words',))
    recording.until_recorded('/words')
    say(write.text('first'))
    recording.until_written('/words')
    for _ in range(10 * DEPTH):  # more than may wait, for the recorder does not spin meanwhile
        say(write.text('too fast'))

    def lost() -> str:
        return read.diagnosis(diagnostics[-1])['lost_of'] if diagnostics else ''

    bench.until(lambda: bool(lost()), 'losses to be reported')
    recording.node.stop()
    kept = len(read_back(recording.bag))
    assert lost() == f'{1 + 10 * DEPTH - kept} of /words'


@pytest.mark.parametrize(
    'kind',
    [
        'antigravity/msg/Fly',
        'evil/msg/Payload',
        'evil.msg/msg/Payload',
        '.evil/msg/Payload',
        'evil',
        'evil/msg/',
        'evil/srv/Payload',
        'std_msgs/msg/String/../Bool',
        'std_msgs/msg/__builtins__',
        'plain/msg/Function',
        '',
    ],
)
def test_nothing_else_is_imported(tmp_path, monkeypatch, kind) -> None:
    mark = tmp_path / 'was_imported'
    for name in ('evil', 'antigravity'):
        (tmp_path / name).mkdir()
        (tmp_path / name / '__init__.py').write_text(f'open({str(mark)!r}, "w")')
    (tmp_path / 'plain' / 'msg').mkdir(parents=True)
    (tmp_path / 'plain' / '__init__.py').touch()
    (tmp_path / 'plain' / 'msg' / '__init__.py').write_text('def Function(): pass')
    monkeypatch.syspath_prepend(tmp_path)
    with pytest.raises(InputError, match=r'is no type of messages|cannot be imported'):
        message_class(kind)
    assert not mark.exists()
    assert not {'evil', 'antigravity'} & sys.modules.keys()


def test_diagnostics_of_others_do_not_pile_up(bench) -> None:
    observer = bench.start(partial(ObserverNode, RunMonitor, lambda *_: None, with_images=False))
    heard = observer.subscriptions
    (listen,) = (it.callback for it in heard if it.topic_name == '/diagnostics')
    for stamp_ns in range(1, 5 * UNFINISHED):
        foreign = write.diagnostics('x', level=b'\0', summary='', values={}, stamp_ns=stamp_ns)
        between = diagnostics.standing_diagnosis(
            ServoState(), Words('it stands'), stamp_ns, name='servo', alarming=False
        )
        for message in (foreign, between, DiagnosticArray()):
            listen(message)
    assert observer._pending == {}


MANY = 50  # fewer than wait in DDS


class Reporter(Recording):
    """A recorder that is led about, and a publisher of words."""

    def __init__(self, bench, folder, **values) -> None:
        self.talker = bench.probe.create_publisher(String, 'words', 10 * MANY)
        super().__init__(bench, folder, topics=('words',), **values)

    def until_heard(self) -> None:
        self.bench.until(
            lambda: self.node.ready and self.talker.get_subscription_count() > 0,
            'words to be recorded',
        )

    def say(self, words: range) -> list[str]:
        """Say words; they have arrived at the recorder, which has taken none."""
        self.bench.executor.remove_node(self.node)
        texts = [str(word) for word in words]
        for text in texts:
            self.talker.publish(write.text(text))
        self.bench.executor.spin_once(timeout_sec=0.05)
        self.bench.executor.add_node(self.node)
        return texts


@pytest.mark.parametrize(
    'ways', [['deactivate'], ['shutdown'], ['deactivate', 'cleanup'], ['destroyed']]
)
def test_no_end_loses_what_was_published_before(bench, tmp_path, ways) -> None:
    reporter = Reporter(bench, tmp_path)
    reporter.until_heard()
    texts = reporter.say(range(MANY))
    for label in ways:
        if label == 'destroyed':
            bench.remove(reporter.node)
        else:
            assert led(reporter.node, 0, label)
    assert reporter.bags() == ['bag']  # and by its name, so it is whole
    assert texts_in(tmp_path / 'bag') == texts


def test_an_inactive_recorder_records_nothing_and_says_what_to_do(bench, tmp_path) -> None:
    reporter = Reporter(bench, tmp_path, autostart_node=False)
    bench.settle()
    assert reporter.bags() == []
    go(bench, reporter.node, 'configure')
    reporter.say(range(MANY))
    bench.settle()
    answer = bench.call('recorder_node/start')
    assert (answer.success, answer.message) == (
        False,
        '/recorder_node is inactive; call ros2 lifecycle set /recorder_node activate',
    )
    assert reporter.bags() == []
    assert not any(item.raw for item in reporter.node.subscriptions)


def test_each_activation_begins_a_bag(bench, tmp_path) -> None:
    reporter = Reporter(bench, tmp_path)
    before = entities(reporter.node)['subscriptions']
    for number in range(3):
        reporter.until_heard()
        texts = reporter.say(range(MANY * number, MANY * (number + 1)))
        go(bench, reporter.node, 'deactivate')
        assert texts_in(tmp_path / reporter.bags()[-1]) == texts
        assert entities(reporter.node)['subscriptions'] < before
        go(bench, reporter.node, *['cleanup', 'configure'][: number % 2 * 2], 'activate')
    bags = [name for name in reporter.bags() if not name.endswith('_3')]
    assert bags == ['bag', 'bag_1', 'bag_2']


def test_a_recorder_that_waits_for_start_waits_after_each_activation(bench, tmp_path) -> None:
    reporter = Reporter(bench, tmp_path, autostart=False)
    assert bench.call('recorder_node/start').success
    go(bench, reporter.node, 'deactivate', 'activate')
    assert reporter.bags() == ['bag']
    assert bench.call('recorder_node/stop').message == 'nothing is being recorded'


def test_a_bag_that_cannot_be_begun_leaves_the_node_inactive(bench, tmp_path) -> None:
    reporter = Reporter(bench, tmp_path, autostart_node=False)
    (tmp_path / 'bag').mkdir()
    go(bench, reporter.node, 'configure')
    assert not change(bench, reporter.node, label='activate')
    assert reporter.node.state == 'inactive'
    bench.until(lambda: bench.logged('bag exists already; name another bag'), 'the reason')
    (tmp_path / 'bag').rmdir()
    assert go(bench, reporter.node, 'activate') == 'active'


def test_an_activation_that_fails_leaves_a_whole_bag_and_records_anew(
    bench, tmp_path, monkeypatch
) -> None:
    reporter = Reporter(bench, tmp_path, autostart_node=False)
    go(bench, reporter.node, 'configure')
    with monkeypatch.context() as patched:
        patched.setattr(RawSubscriptions, 'discover', lambda _: 1 / 0)
        assert not change(bench, reporter.node, label='activate')
    assert (reporter.node.state, reporter.bags()) == ('unconfigured', ['bag'])
    go(bench, reporter.node, 'configure', 'activate')
    reporter.until_heard()
    texts = reporter.say(range(MANY))
    go(bench, reporter.node, 'deactivate')
    assert [texts_in(tmp_path / name) for name in reporter.bags()] == [[], texts]


def test_the_diagnostics_say_that_nothing_is_recorded_any_more(bench, tmp_path) -> None:
    heard = bench.listen(DiagnosticArray, '/diagnostics')
    reporter = Reporter(bench, tmp_path)
    bench.until(lambda: bool(heard), 'a report')
    assert read.diagnosis(heard[-1])['recording'] == 'True'
    go(bench, reporter.node, 'deactivate')
    bench.until(lambda: read.diagnosis(heard[-1])['recording'] == 'False', 'the last report')
    told = len(heard)
    bench.settle()
    assert len(heard) == told
