"""Containers that people hand over: read, or one true line says what they are."""

from collections.abc import Callable
from pathlib import Path
import shutil
import sqlite3

from bagmaker import (
    kind_of,
    Message,
    tiny_run,
    write_bag,
    write_ros1,
    write_ros1_mcap,
)
import cv2
from mcap.writer import CompressionType, IndexType, Writer
from mixed_mcap import register_ros2, SECOND, without_index, write_mixed
import numpy as np
import pytest
from rosbags.rosbag2 import CompressionMode, StoragePlugin
import yaml
import zstandard

from visual_servo_epipolar.bags.reading.bag import Bag
from visual_servo_epipolar.commands.main import main
from visual_servo_epipolar.core.errors import InputError

RECORDED = Path(__file__).parents[1] / 'recorded'
SQLITE3, MCAP = StoragePlugin.SQLITE3, StoragePlugin.MCAP
HIDDEN = ('/go/_action/feedback', 'own_msgs/action/Go_FeedbackMessage')
NOT_FOUND = 'left out, for the definition of their type was not found when recording: ' + (
    f'{HIDDEN[0]} ({HIDDEN[1]})'
)
NO_ROS = [
    'left out, for their messages are json, not of ROS: /poses (Pose), /silent (Pose)',
    'left out, for their messages are application/octet-stream, not of ROS: /bytes',
]


@pytest.fixture(scope='module')
def tiny() -> list[Message]:
    return [(topic, log_ns + SECOND, raw) for topic, log_ns, raw in tiny_run()]


@pytest.fixture(scope='module')
def ros(tiny) -> list[tuple[str, str, int, bytes]]:
    return [(topic, kind_of(topic), log_ns, raw) for topic, log_ns, raw in tiny]


@pytest.fixture(scope='module')
def expected(tiny, tmp_path_factory) -> list[tuple[str, int]]:
    """Return topics and times of recording of the run, as a whole bag gives them."""
    return read(write_bag(tmp_path_factory.mktemp('whole') / 'bag', tiny))[0]


def read(path: Path) -> tuple[list[tuple[str, int]], list[str]]:
    """Return topics and times of all messages, once they are decoded, and the notes."""
    with Bag(path) as bag:
        found = [(item.topic, item.log_ns) for item in bag.messages(bag.topics)]
        assert len(found) == sum(item.count for item in bag.topics.values())
        return found, bag.notes


@pytest.mark.parametrize('compression', list(CompressionType))
@pytest.mark.parametrize('profile', ['ros2', ''])
def test_topics_of_ros_are_read_others_left(ros, expected, tmp_path, compression, profile) -> None:
    file = write_mixed(tmp_path / 'a.mcap', ros, compression=compression, profile=profile)
    assert read(file) == (expected, NO_ROS)


@pytest.mark.parametrize(
    'options',
    [
        {'use_chunking': False},
        {'repeat_channels': False},
        {'repeat_channels': False, 'repeat_schemas': False},
        {'use_statistics': False},
        {'index_types': IndexType.CHUNK},
        {'index_types': IndexType.NONE},
        {'use_summary_offsets': False},
    ],
)
def test_each_part_of_an_index_may_be_missing(ros, expected, tmp_path, options) -> None:
    assert read(write_mixed(tmp_path / 'a.mcap', ros, **options))[0] == expected


@pytest.mark.parametrize('chunked', [True, False])
def test_without_an_index_messages_are_read_in_order(ros, expected, tmp_path, chunked) -> None:
    assert read(without_index(tmp_path / 'a.mcap', ros, use_chunking=chunked))[0] == expected
    mixed_up = [*ros[20:], *ros[:20]]
    assert read(without_index(tmp_path / 'b.mcap', mixed_up, use_chunking=chunked))[0] == expected


def undefined_mcap(folder: Path, ros: list, schema: str) -> Path:
    with (folder / 'a.mcap').open('wb') as file:
        writer = Writer(file)
        writer.start('ros2')
        number = writer.register_schema(HIDDEN[1], schema, b'')
        hidden = writer.register_channel(HIDDEN[0], 'cdr', number)
        channels = {topic: register_ros2(writer, topic, kind) for topic, kind, _, _ in ros}
        writer.add_message(hidden, 5, b'\x00\x01\x00\x00abcd', 5)
        for topic, _, log_ns, raw in ros:
            writer.add_message(channels[topic], log_ns, raw, log_ns)
        writer.finish()
    return folder / 'a.mcap'


def undefined_sqlite(folder: Path, tiny: list[Message], schema: str) -> Path:
    bag = write_bag(folder / 'bag', tiny, storage=SQLITE3)
    with sqlite3.connect(bag / 'bag.db3') as db:
        db.execute("INSERT INTO topics VALUES (99, ?, ?, 'cdr', '', '')", HIDDEN)
        db.execute(
            'INSERT INTO message_definitions(topic_type, encoding, encoded_message_definition, '
            "type_description_hash) VALUES (?, ?, '', '')",
            (HIDDEN[1], schema),
        )
        db.execute("INSERT INTO messages(topic_id, timestamp, data) VALUES (99, 5, x'00010000')")
    db.close()
    metadata = yaml.safe_load((bag / 'metadata.yaml').read_text())
    topics = metadata['rosbag2_bagfile_information']['topics_with_message_count']
    name = {**topics[0]['topic_metadata'], 'name': HIDDEN[0], 'type': HIDDEN[1]}
    topics.append({'topic_metadata': name, 'message_count': 1})
    (bag / 'metadata.yaml').write_text(yaml.safe_dump(metadata))
    return bag


@pytest.mark.parametrize('schema', ['unknown', ''])
def test_a_topic_not_defined_is_left_out(tiny, ros, expected, tmp_path, schema, capsys) -> None:
    bag = undefined_sqlite(tmp_path, tiny, schema)
    for path in (undefined_mcap(tmp_path, ros, schema), bag, bag / 'bag.db3'):
        assert read(path) == (expected, [NOT_FOUND])
        assert main(['replay', str(path)]) == 0
        assert f'  note: {NOT_FOUND}\n' in capsys.readouterr().out


def test_ros_1_in_mcap_gives_the_same_commands(tiny, expected, tmp_path, capsys) -> None:
    path = write_ros1_mcap(tmp_path / 'ros1.mcap', tiny)
    assert read(path) == (expected, [])
    assert main(['replay', str(path)]) == 0
    assert 'recorded and replayed: 4 steps, the same to the last bit' in capsys.readouterr().out


@pytest.mark.parametrize('storage', [SQLITE3, MCAP])
@pytest.mark.parametrize('mode', [CompressionMode.MESSAGE, CompressionMode.FILE])
def test_compressed_by_rosbag2_it_is_read_whole(tiny, expected, tmp_path, storage, mode) -> None:
    bag = write_bag(tmp_path / 'bag', tiny, storage=storage, compression=mode)
    file = next(item for item in bag.iterdir() if item.name != 'metadata.yaml')
    assert read(bag) == read(file) == (expected, [])
    (bag / 'metadata.yaml').unlink()
    assert read(bag) == (expected, [])


def test_packed_files_alone_are_read(ros, expected, tmp_path) -> None:
    plain = write_mixed(tmp_path / 'a.mcap', ros)
    for name in ('a.mcap.zstd', 'a.mcap.zst', 'a'):
        packed = tmp_path / name
        packed.write_bytes(zstandard.compress(plain.read_bytes()))
        assert read(packed)[0] == expected


def with_information(key: str, value: object) -> Callable[[Path], None]:
    def change(bag: Path) -> None:
        content = yaml.safe_load((bag / 'metadata.yaml').read_text())
        information = content['rosbag2_bagfile_information']
        if value is None:
            del information[key]
        else:
            information[key] = value
        (bag / 'metadata.yaml').write_text(yaml.safe_dump(content))

    return change


def renamed_to(name: str) -> Callable[[Path], None]:
    def change(bag: Path) -> None:
        next(item for item in bag.iterdir() if item.name != 'metadata.yaml').rename(bag / name)

    return change


@pytest.mark.parametrize('storage', [SQLITE3, MCAP])
@pytest.mark.parametrize(
    'change',
    [
        *(with_information('storage_identifier', item) for item in ('', None, 'MCAP', 'sqlite3')),
        *(with_information('topics_with_message_count', item) for item in ([], None)),
        *(with_information(item, None) for item in ('version', 'duration', 'message_count')),
        *(renamed_to(item) for item in ('kitchen', 'kitchen.bin', 'kitchen.MCAP', 'x.db3')),
        lambda bag: (bag / 'metadata.yaml').unlink(),
    ],
)
def test_bytes_tell_what_metadata_do_not(tiny, expected, tmp_path, storage, change) -> None:
    bag = write_bag(tmp_path / 'bag', tiny, storage=storage)
    change(bag)
    before = {item: item.read_bytes() for item in bag.iterdir()}
    assert read(bag) == (expected, [])
    assert {item: item.read_bytes() for item in bag.iterdir()} == before


def test_its_metadata_stands_for_the_folder(tiny, expected, tmp_path) -> None:
    bag = write_bag(tmp_path / 'bag', tiny)
    assert read(bag / 'metadata.yaml') == (expected, [])


def test_the_parts_of_a_bag_are_read_one_after_the_other(tiny, ros, expected, tmp_path) -> None:
    third = len(ros) // 3
    for number, part in enumerate((ros[:third], ros[third : 2 * third], ros[2 * third :])):
        write_mixed(tmp_path / f'bag_{number}.mcap', part)
    assert read(tmp_path)[0] == expected


def database(path: Path) -> None:
    with sqlite3.connect(path) as db:
        db.execute('CREATE TABLE contacts(name TEXT)')
    db.close()


def picture(path: Path) -> None:
    path.write_bytes(cv2.imencode('.png', np.zeros((9, 9), np.uint8))[1].tobytes())


def folder_of_pictures(path: Path) -> None:
    path.mkdir()
    picture(path / '1.png')


def protobuf(path: Path) -> None:
    with path.open('wb') as file:
        writer = Writer(file)
        writer.start('')
        schema = writer.register_schema('foxglove.CompressedImage', 'protobuf', b'\x0a')
        channel = writer.register_channel('/camera', 'protobuf', schema)
        writer.add_message(channel, 1, b'\x08\x01', 1)
        writer.finish()


def cut(path: Path) -> None:
    write_mixed(path.with_name('whole'))
    path.write_bytes(path.with_name('whole').read_bytes()[:-200])


def cut_database(path: Path) -> None:
    path.write_bytes((RECORDED / 'sqlite3/sqlite3_0.db3').read_bytes()[:50_000])


def packed_and_cut(path: Path) -> None:
    write_mixed(path.with_name('whole'))
    path.write_bytes(zstandard.compress(path.with_name('whole').read_bytes())[:-200])


def of_bytes(data: bytes) -> Callable[[Path], None]:
    return lambda path: path.write_bytes(data) and None


STRANGERS: dict[str, tuple[Callable[[Path], object], str]] = {
    'text.txt': (of_bytes(b'no bag'), 'not a bag; give a rosbag2 folder'),
    'x.png': (picture, 'not a bag; give a rosbag2 folder'),
    'void': (lambda path: path.mkdir(), 'not a bag: it has neither metadata.yaml nor .mcap or'),
    'void.mcap': (lambda path: path.touch(), 'it is empty, nothing was recorded; give another'),
    'void.db3': (lambda path: path.touch(), 'it is empty, nothing was recorded; give another'),
    'contacts.db3': (database, 'a database without the tables of a bag; give another'),
    'contacts.bin': (database, 'a database without the tables of a bag; give another'),
    'protobuf.mcap': (
        protobuf,
        'none of its topics can be read: left out, for their messages are protobuf, not of ROS: '
        '/camera (foxglove.CompressedImage); record topics of ROS with "ros2 bag record", or',
    ),
    'cut.mcap': (
        cut,
        'its end is missing; the bag is damaged or was left open by a crash; try --r',
    ),
    'cut.db3': (cut_database, 'it is damaged; try "sqlite3 cut.db3 .recover | sqlite3 NEW.db3"'),
    'cut.mcap.zstd': (packed_and_cut, 'unpack what is there with "zstd -dc cut.mcap.zstd > cut.m'),
    'nothing': (lambda path: None, 'no such bag; give a rosbag2 folder, a .mcap, .db3 or .bag'),
}


@pytest.mark.parametrize('name', STRANGERS)
def test_what_cannot_be_read_is_one_true_line(name, tmp_path, capsys) -> None:
    make, reason = STRANGERS[name]
    make(tmp_path / name)
    for command in ('replay', 'report'):
        assert main([command, str(tmp_path / name)]) == 2
        shown = capsys.readouterr()
        assert shown.out == '' and len(shown.err.splitlines()) == 1
        assert shown.err.startswith(f'visual_servo {command}: {tmp_path / name}: ')
        assert reason in shown.err
        assert 'repair' not in shown.err or name in ('cut.mcap', 'cut.mcap.zstd', 'void')


def test_a_ros_1_bag_that_was_left_open_is_not_promised_to_be_repaired(tiny, tmp_path) -> None:
    whole = write_ros1(tmp_path / 'run.bag', tiny).read_bytes()
    for name in ('cut.bag', 'run.bag.active'):
        file = tmp_path / name
        file.write_bytes(whole[: len(whole) // 2])
        with pytest.raises(InputError, match='left open; try "rosbag reindex" of ROS 1'):
            Bag(file)
        assert main(['replay', str(file), '--repair']) == 2
        assert file.read_bytes() == whole[: len(whole) // 2]


def test_another_compression_is_named(tiny, tmp_path) -> None:
    bag = write_bag(tmp_path / 'bag', tiny)
    with_information('compression_mode', 'MESSAGE')(bag)
    with_information('compression_format', 'lz4')(bag)
    with pytest.raises(InputError, match='compressed by lz4, of which only zstd can be read; un'):
        Bag(bag)


@pytest.mark.parametrize('others', [True, False])
def test_a_part_that_is_lost_is_named(tiny, ros, tmp_path, others) -> None:
    bag = write_bag(tmp_path / 'bag', tiny)
    files = ['bag.mcap', 'bag_1.mcap'] if others else ['bag_1.mcap']
    with_information('relative_file_paths', files)(bag)
    if not others:
        (bag / 'bag.mcap').unlink()
    with pytest.raises(InputError, match='it lacks bag_1.mcap, which metadata.yaml lists') as info:
        Bag(bag)
    assert ('--repair' in str(info.value)) == others


def test_a_part_left_open_is_not_passed_over(tiny, expected, tmp_path) -> None:
    bag = write_bag(tmp_path / 'bag', tiny)
    (bag / 'bag_1').mkdir()
    shutil.copy(bag / 'bag.mcap', bag / 'bag_1/bag_1.mcap')
    found, notes = read(bag)
    assert found == expected
    assert notes == ['left open by a crash and not read: bag_1/bag_1.mcap; --repair completes it']


def test_what_a_killed_recorder_left_in_the_log_is_read(tiny, expected, tmp_path) -> None:
    bag = write_bag(tmp_path / 'bag', tiny, storage=SQLITE3)
    db = sqlite3.connect(bag / 'bag.db3')
    db.execute('PRAGMA journal_mode = WAL')
    db.execute('UPDATE messages SET timestamp = timestamp + 1')
    db.commit()
    folder = tmp_path / 'crashed'
    shutil.copytree(bag, folder)  # as it stands while the recorder has it open
    db.close()
    (folder / 'bag.db3-shm').unlink()
    before = (folder / 'bag.db3').read_bytes()
    assert read(folder)[0] == [(topic, log_ns + 1) for topic, log_ns in expected]
    assert (folder / 'bag.db3').read_bytes() == before


def test_a_topic_that_is_left_out_is_not_denied(ros, tmp_path, capsys) -> None:
    path = write_mixed(tmp_path / 'a.mcap', ros)
    assert main(['replay', str(path), '--topics', 'image=/poses']) == 2
    shown = capsys.readouterr().err
    assert "no topic '/poses'; it has /camera_info" in shown and NO_ROS[0] in shown


def test_a_damaged_definition_without_topics_does_no_harm(tiny, expected, tmp_path) -> None:
    bag = write_bag(tmp_path / 'bag', tiny, storage=SQLITE3)
    db = sqlite3.connect(bag / 'bag.db3')
    db.execute(
        'INSERT INTO message_definitions (topic_type, encoding, encoded_message_definition, '
        "type_description_hash) VALUES ('own_msgs/msg/Other', 'ros2msg', "
        "CAST(x'ff80' AS TEXT), '')"
    )
    db.commit()
    db.close()
    assert read(bag)[0] == expected
