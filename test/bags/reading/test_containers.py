"""Containers: every kind of rosbag2 is read whole, and what is none is one clear line."""

from collections.abc import Callable
from contextlib import closing
from pathlib import Path
import shutil
import sqlite3

from bagmaker import Message, tiny_run, write_bag
import cv2
from mcap.writer import CompressionType
from mixed_mcap import SECOND, write_mixed
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


@pytest.fixture(scope='module')
def tiny() -> list[Message]:
    return [(topic, log_ns + SECOND, raw) for topic, log_ns, raw in tiny_run()]


def expected(tiny: list[Message]) -> list[tuple[str, int]]:
    return [(topic, log_ns) for topic, log_ns, _ in tiny]


def read(path: Path) -> tuple[list[tuple[str, int]], list[str]]:
    """Return topics and times of all messages, once they are decoded, and the notes."""
    with Bag(path) as bag:
        found = [(item.topic, item.log_ns) for item in bag.messages(bag.topics)]
        assert len(found) == sum(item.count for item in bag.topics.values())
        return found, bag.notes


@pytest.mark.parametrize('storage', [SQLITE3, MCAP])
@pytest.mark.parametrize('mode', list(CompressionMode))
def test_a_bag_is_read_whole(tiny, tmp_path, storage, mode) -> None:
    if (storage, mode) == (SQLITE3, CompressionMode.STORAGE):
        return  # mcap alone compresses within the file
    bag = write_bag(tmp_path / 'bag', tiny, storage=storage, compression=mode)
    assert read(bag) == read(bag / 'metadata.yaml') == (expected(tiny), [])
    if mode in (CompressionMode.NONE, CompressionMode.STORAGE):
        (bag / 'metadata.yaml').unlink()
        assert read(bag) == read(next(bag.iterdir())) == (expected(tiny), [])


def test_the_parts_of_a_bag_are_read_one_after_the_other(tiny, tmp_path) -> None:
    for number in range(11):
        part = [item for k, item in enumerate(tiny) if k * 11 // len(tiny) == number]
        source = write_bag(tmp_path / f'{number}', part)
        (tmp_path / 'bag').mkdir(exist_ok=True)
        shutil.copy(source / f'{number}.mcap', tmp_path / f'bag/bag_{number}.mcap')
    assert read(tmp_path / 'bag')[0] == expected(tiny)


def test_topics_not_of_ros_are_left_out_and_named(tiny, tmp_path) -> None:
    bag = write_bag(tmp_path / 'bag', tiny, storage=SQLITE3)
    with closing(sqlite3.connect(bag / 'bag.db3')) as db:
        for row in ((98, '/poses', 'Pose', 'json'), (99, '/own', 'own_msgs/msg/Own', 'cdr')):
            db.execute("INSERT INTO topics VALUES (?, ?, ?, ?, '', '')", row)
        db.commit()
    found, notes = read(bag / 'bag.db3')
    assert found == expected(tiny)
    assert notes == [
        'left out, for their messages or the definitions of their types are not of ROS: '
        '/own, /poses'
    ]


def database(path: Path) -> None:
    with closing(sqlite3.connect(path)) as db:
        db.execute('CREATE TABLE contacts(name TEXT)')
        db.commit()


def picture(path: Path) -> None:
    path.write_bytes(cv2.imencode('.png', np.zeros((9, 9), np.uint8))[1].tobytes())


def cut(path: Path) -> None:
    data = write_mixed(path.with_name('whole'), compression=CompressionType.ZSTD).read_bytes()
    path.write_bytes(data[:-200])


def cut_database(path: Path) -> None:
    path.write_bytes((RECORDED / 'sqlite3/sqlite3_0.db3').read_bytes()[:50_000])


def of_bytes(data: bytes) -> Callable[[Path], object]:
    return lambda path: path.write_bytes(data)


def folder_of_bags(path: Path) -> None:
    shutil.copytree(RECORDED / 'mcap', path / 'mcap')


STRANGERS: dict[str, tuple[Callable[[Path], object], str]] = {
    'text.txt': (of_bytes(b'no bag'), 'not a bag that can be read; give a rosbag2 folder'),
    'x.png': (picture, 'not a bag that can be read; give a rosbag2 folder'),
    'void': (lambda path: path.mkdir(), 'not a bag; give a rosbag2 folder'),
    'bags': (folder_of_bags, 'not a bag, but a folder with one; give '),
    'void.mcap': (lambda path: path.touch(), 'it is empty, nothing was recorded; give another'),
    'void.db3': (lambda path: path.touch(), 'it is empty, nothing was recorded; give another'),
    'contacts.db3': (database, 'database missing tables; if it is damaged, try "sqlite3 contacts'),
    'mixed.mcap': (write_mixed, "unknown 'jsonschema'; what is not of ROS 2 can be left out by"),
    'cut.mcap': (cut, 'if it is damaged, or was left open by a crash, try --repair'),
    'cut.db3': (cut_database, 'if it is damaged, try "sqlite3 cut.db3 .recover | sqlite3 NEW.db3'),
    'a.mcap.zstd': (of_bytes(zstandard.compress(b'')), 'unpack it with "zstd -d a.mcap.zstd", or'),
    'a.bag': (of_bytes(b'#ROSBAG V2.0'), 'ROS 1 with "rosbags-convert --src a.bag --dst NEW"'),
    'nothing': (lambda path: None, 'no such bag; give a rosbag2 folder, a .mcap or a .db3 file'),
}


@pytest.mark.parametrize('name', STRANGERS)
def test_what_cannot_be_read_is_one_true_line(name, tmp_path, capsys) -> None:
    make, reason = STRANGERS[name]
    make(tmp_path / name)
    assert main(['replay', str(tmp_path / name)]) == 2
    shown = capsys.readouterr()
    assert shown.out == '' and len(shown.err.splitlines()) == 1
    assert shown.err.startswith(f'visual_servo replay: {tmp_path / name}: ')
    assert reason in shown.err


@pytest.mark.parametrize(
    ('key', 'value', 'reason'),
    [
        ('compression_format', 'lz4', "Compression format 'lz4' is not supported"),
        ('relative_file_paths', ['bag.mcap', 'bag_1.mcap'], 'files are missing.*bag_1.mcap'),
        ('message_count', None, "key is missing KeyError.'message_count'.*; .* try --repair"),
    ],
)
def test_metadata_that_do_not_hold_are_named(tiny, tmp_path, key, value, reason) -> None:
    bag = write_bag(tmp_path / 'bag', tiny, compression=CompressionMode.MESSAGE)
    content = yaml.safe_load((bag / 'metadata.yaml').read_text())
    content['rosbag2_bagfile_information'][key] = value
    if value is None:
        del content['rosbag2_bagfile_information'][key]
    (bag / 'metadata.yaml').write_text(yaml.safe_dump(content))
    with pytest.raises(InputError, match=reason):
        Bag(bag)
