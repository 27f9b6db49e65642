"""The life cycle of the recorder: whatever state it is led to, the bag is whole."""

from bag_reading import read_back
from diagnostic_msgs.msg import DiagnosticArray
from lifecycles import change, entities, go, led
import pytest
from rclpy.serialization import deserialize_message
from std_msgs.msg import String

from visual_servo_epipolar.messages import read, write
from visual_servo_epipolar.nodes.raw_subscriptions import RawSubscriptions
from visual_servo_epipolar.nodes.recorder_node import RecorderNode

MANY = 50  # fewer than wait in DDS


def said_in(folder) -> list[str]:
    """Return the words in a bag, in their order."""
    return [deserialize_message(data, String).data for _, _, data in read_back(folder)]


class Reporter:
    """A recorder that is led about, and a publisher of words."""

    def __init__(self, bench, folder, **values) -> None:
        self.bench, self.folder = bench, folder
        self.talker = bench.probe.create_publisher(String, 'words', 10 * MANY)
        self.node = bench.start(RecorderNode, bag=str(folder / 'bag'), topics=('words',), **values)

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

    def bags(self) -> list[str]:
        return sorted(path.name for path in self.folder.iterdir())


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
    assert said_in(tmp_path / 'bag') == texts


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
        assert said_in(tmp_path / reporter.bags()[-1]) == texts
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
    assert [said_in(tmp_path / name) for name in reporter.bags()] == [[], texts]


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
