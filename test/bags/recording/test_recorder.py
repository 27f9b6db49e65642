"""The recorder: what goes in comes out, as the readers of this world see it."""

from pathlib import Path
import re
import threading

from bag_reading import read_back, recorded, TEXT, until, WORDS, words
from mcap.reader import make_reader
from mcap_ros2.decoder import DecoderFactory
import pytest

from visual_servo_epipolar.bags.recording.recorder import Recorder, Topic
from visual_servo_epipolar.bags.recording.settings import RecordSettings
from visual_servo_epipolar.core.errors import InputError


@pytest.mark.parametrize('compression', ['none', 'zstd'])
def test_every_message_is_read_back_byte_by_byte(tmp_path, compression) -> None:
    bag, expected = recorded(tmp_path, compression=compression), [f'{k:05000}' for k in range(100)]
    assert read_back(bag) == [(WORDS.name, k, words(text)) for k, text in enumerate(expected)]
    assert {path.name for path in bag.iterdir()} == {'metadata.yaml', 'bag_0.mcap'}
    with (bag / 'bag_0.mcap').open('rb') as file:  # the official reader of mcap
        reader = make_reader(file, decoder_factories=[DecoderFactory()])
        texts = [message.data for *_, message in reader.iter_decoded_messages()]
    assert texts == expected


@pytest.mark.parametrize('sourced', ['', 'kilted'])
def test_a_bag_names_the_distribution_of_ros(tmp_path, monkeypatch, sourced) -> None:
    monkeypatch.setenv('ROS_DISTRO', sourced)
    recorded(tmp_path)
    for name in ('metadata.yaml', 'bag_0.mcap'):  # a file alone says so as well
        expected = f'ros_distro: {sourced or "jazzy"}'
        assert expected.encode() in (tmp_path / 'bag' / name).read_bytes()


def test_sqlite3_is_refused_with_what_to_do_instead() -> None:
    with pytest.raises(ValueError, match='storage must be mcap, got sqlite3.*"ros2 bag convert"'):
        RecordSettings(storage='sqlite3')


def burst(folder: Path, when_full: str) -> tuple[int, int, int]:
    """Offer far more than may wait; return how many were taken, written, dropped."""
    recorder = Recorder(folder, RecordSettings(queue_size=0.001, when_full=when_full))
    recorder.add(WORDS)
    data = words('x' * 200_000)
    taken = sum(recorder.put(WORDS, number, data) for number in range(300))
    status = recorder.close()
    return taken, status.written[WORDS.name], status.dropped.get(WORDS.name, 0)


def test_what_a_slow_disk_cannot_take_is_dropped_and_counted(tmp_path) -> None:
    taken, written, dropped = burst(tmp_path / 'bag', 'drop')
    assert taken == written == len(read_back(tmp_path / 'bag'))
    assert (dropped, written + dropped) > (0, 0)
    assert written + dropped == 300


def test_what_is_taken_up_to_the_end_is_written(tmp_path) -> None:
    recorder = Recorder(tmp_path / 'bag')
    recorder.add(WORDS)
    taken: list[int] = []

    def offer() -> None:
        while recorder.put(WORDS, len(taken), words('x')):
            taken.append(len(taken))

    talker = threading.Thread(target=offer)
    talker.start()
    until(lambda: len(taken) > 1000, 'messages to come')
    recorder.close()
    talker.join(10.0)
    status = recorder.status()
    assert (status.written, status.dropped) == ({'/words': len(taken)}, {'/words': 1})
    assert [stamp_ns for _, stamp_ns, _ in read_back(tmp_path / 'bag')] == taken


def test_where_time_waits_nothing_is_dropped(tmp_path) -> None:
    assert burst(tmp_path / 'bag', 'wait') == (300, 300, 0)
    assert len(read_back(tmp_path / 'bag')) == 300


@pytest.mark.parametrize(
    ('name', 'min_free', 'reason'),
    [
        ('bag', 1e7, 'MB are free .* must stay free; make space'),
        ('there', 0.0, 'exists already; name another bag'),
        ('file/bag', 0.0, 'bag cannot be written: Not a directory'),
    ],
)
def test_a_bag_that_cannot_be_begun_is_refused_and_nothing_is_left(
    tmp_path, name, min_free, reason
) -> None:
    (tmp_path / 'there').mkdir()
    (tmp_path / 'file').touch()
    with pytest.raises(InputError, match=reason):
        Recorder(tmp_path / name, RecordSettings(min_free=min_free))
    assert {path.name for path in tmp_path.rglob('*')} == {'there', 'file'}


def test_a_message_type_without_a_definition_is_refused(tmp_path) -> None:
    recorder = Recorder(tmp_path / 'bag')
    with pytest.raises(
        InputError, match='no definition of our_msgs/msg/Own .* record it by ros2 bag'
    ):
        recorder.add(Topic('/own', 'our_msgs/msg/Own'))
    with pytest.raises(InputError, match='no definition of std_msgs/msg/String RIHS01_00'):
        recorder.add(Topic('/other', TEXT, 'RIHS01_00'))
    recorder.close()
    assert read_back(tmp_path / 'bag') == []


@pytest.mark.filterwarnings('ignore::pytest.PytestUnhandledThreadExceptionWarning')
def test_a_mistake_of_ours_is_not_passed_over_in_silence(tmp_path) -> None:
    recorder = Recorder(tmp_path / 'bag')
    recorder.put(WORDS, 0, words('of a topic that nobody made known'))
    status = recorder.close()
    assert re.match('recording ended: a mistake in the recorder, .* so far is whole', status.error)
    assert read_back(tmp_path / 'bag') == []
