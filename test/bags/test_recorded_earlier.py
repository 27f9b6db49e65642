"""Bags that the recorder of fae70b72 wrote: they are read, replayed, and repaired after a kill."""

from pathlib import Path
import shutil

import pytest

from visual_servo_epipolar.bags.reading.bag import Bag
from visual_servo_epipolar.bags.repair import repair
from visual_servo_epipolar.commands.main import main

# A run of a second, two images of 160x128 px; only one of the bags holds images.
RECORDED = Path(__file__).parent / 'recorded'
COUNTS = {
    '/camera_info': 2,
    '/cmd_vel': 2,
    '/diagnostics': 2,
    '/epipoles': 2,
    '/ground_truth': 3,
    '/phase': 3,
    '/servo_node/settings': 1,
    '/tracker_node/settings': 1,
    '/tracks': 2,
}
IMAGES = {'/image_raw': 2, '/tracker_node/desired/image_raw': 1}
BAGS = [('mcap', COUNTS), ('zstd', COUNTS | IMAGES), ('sqlite3', COUNTS)]


def counts(path: Path) -> dict[str, int]:
    """Return how many messages of each topic can be decoded."""
    with Bag(path) as bag:
        found = dict.fromkeys((name for name, item in bag.topics.items() if item.count), 0)
        for item in bag.messages(bag.topics):
            found[item.topic] += 1
    return found


@pytest.mark.parametrize(('name', 'expected'), BAGS)
def test_every_message_of_an_earlier_recorder_is_read(name, expected) -> None:
    assert counts(RECORDED / name) == expected
    for file in (RECORDED / name).glob('*_0.*'):
        assert counts(file)['/tracks'] > 0


@pytest.mark.parametrize('name', ['mcap', 'zstd', 'sqlite3'])
def test_it_is_replayed(name, capsys) -> None:
    assert main(['replay', str(RECORDED / name)]) in (0, 1)  # laws may have changed since
    shown = capsys.readouterr()
    assert shown.err == ''
    assert f'2 steps from {"images" if name == "zstd" else "tracks"}, 0.5 s' in shown.out


def test_what_an_earlier_recorder_left_open_is_repaired(tmp_path) -> None:
    bag = shutil.copytree(RECORDED / 'mcap', tmp_path / 'mcap')
    (bag / 'metadata.yaml').unlink()
    data = (bag / 'mcap_1.mcap').read_bytes()
    (bag / 'mcap_1.mcap').write_bytes(data[:-1000])
    assert repair(bag).messages == sum(counts(bag).values()) == sum(COUNTS.values())
