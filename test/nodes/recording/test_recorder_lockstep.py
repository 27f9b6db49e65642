"""In lockstep a run is recorded whole, the same each time, and the run is what it is without."""

from collections import Counter
from dataclasses import dataclass
from pathlib import Path

from bag_reading import read_back
from mcap.reader import make_reader
from mcap_ros2.decoder import DecoderFactory
import pytest
from rclpy.publisher import Publisher
from rosbags.highlevel import AnyReader

from visual_servo_epipolar.core.servo.run_log import RunLog
from visual_servo_epipolar.messages import read
from visual_servo_epipolar.nodes.lockstep import Lockstep
from visual_servo_epipolar.nodes.recording.observer_node import ObserverNode
from visual_servo_epipolar.simulation.run_monitor import RunMonitor
from visual_servo_epipolar.simulation.scenario import from_document

START = (0.3, -2.2, 0.0)
TINY = {
    'camera': {
        'width': 320,
        'height': 240,
        'focal_length': 192.0,
        'principal_u': 159.5,
        'principal_v': 119.5,
    },
    'run': {'max_duration': 1.0},
}


def drive(folder: Path | None) -> RunLog:
    """Let the nodes drive for a second, and record it to ``folder``."""
    scenario = from_document(TINY, 'tiny').seeded(1)
    settings = scenario.loop(START, 1)
    monitor = RunMonitor(settings)
    with Lockstep(scenario, settings) as nodes:
        nodes.add(ObserverNode(monitor, lambda *_: None, with_images=False, context=nodes.context))
        if folder is not None:
            nodes.record(folder)
        nodes.run(lambda: monitor.done)
    return monitor.log()


@dataclass(frozen=True)
class Run:
    """A run that was recorded, and how many messages were published on each topic."""

    bag: Path
    log: RunLog
    published: Counter[str]


@pytest.fixture(scope='module')
def run(tmp_path_factory) -> Run:
    counts: Counter[str] = Counter()
    publish = Publisher.publish

    def counted(self, message) -> None:
        counts[self.topic_name] += 1
        publish(self, message)

    bag = tmp_path_factory.mktemp('lockstep') / 'bag'
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(Publisher, 'publish', counted)
        return Run(bag, drive(bag), counts)


def test_every_message_of_every_topic_is_recorded(run) -> None:
    expected = run.published - Counter({'/parameter_events': 10**6})
    assert expected['/image_raw'] > 10
    assert Counter(topic for topic, _, _ in read_back(run.bag)) == expected


def test_two_runs_make_the_same_bag(run, tmp_path) -> None:
    drive(tmp_path / 'bag')
    # Which of two topics comes first at the same time is left to the executor.
    assert sorted(read_back(tmp_path / 'bag')) == sorted(read_back(run.bag))


def test_the_run_is_what_it_is_without_a_recorder(run) -> None:
    assert repr(run.log) == repr(drive(None))


def test_the_official_reader_of_mcap_decodes_every_message(run) -> None:
    (file,) = run.bag.glob('*.mcap')
    with file.open('rb') as stream:
        reader = make_reader(stream, decoder_factories=[DecoderFactory()])
        counts = Counter(channel.topic for _, channel, _, _ in reader.iter_decoded_messages())
    assert counts == Counter(topic for topic, _, _ in read_back(run.bag))


def test_rosbags_decodes_every_message_and_stamps_agree(run) -> None:
    with AnyReader([run.bag]) as reader:
        for connection, stamp_ns, data in reader.messages():
            message = reader.deserialize(data, connection.msgtype)
            if connection.topic in ('/image_raw', '/tracks', '/epipoles', '/ground_truth'):
                assert read.stamp_ns(message.header) == stamp_ns, connection.topic
