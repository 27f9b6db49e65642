"""The bag that a demo leaves: it is replayed to the commands that were given."""

from pathlib import Path

from bag_reading import read_back
from bagmaker import decoded
from command_line import TINY
import pytest

from visual_servo_epipolar.commands.main import main

pytest.importorskip('rclpy')


def topics(bag: Path) -> set[str]:
    return {topic for topic, _, _ in read_back(bag)}


def demo(folder: Path, *more: str) -> int:
    """Run a demo of one second into ``folder``; it fails, for that is too short."""
    (folder / 'tiny.yaml').write_text(f'{TINY}run: {{max_duration: 1.0}}')
    start = ('--start', '0.3', '-2.2', '0', '--scenario', str(folder / 'tiny.yaml'))
    return main(['demo', *start, '--no-video', '--out', str(folder / 'out'), *more])


def test_a_bag_without_images_is_the_default_and_replaces_the_one_before(tmp_path, capsys) -> None:
    bag = tmp_path / 'out/bag'  # of an earlier demo, and one that it was killed in
    (bag / 'bag_7').mkdir(parents=True)
    for name in ('metadata.yaml', 'bag_0.mcap', 'bag_7/bag_7.mcap', '../video.mp4'):
        (bag / name).touch()
    assert demo(tmp_path, '--rig', 'car') == 1
    files = ('bag', 'result.json', 'run.json', 'signals.png', 'trajectory.png')
    assert sorted(path.name for path in (tmp_path / 'out').iterdir()) == list(files)
    shown = capsys.readouterr().out.splitlines()[-1]
    assert shown == f'written to {tmp_path / "out"}: {", ".join(files)}'
    assert {path.name for path in bag.iterdir()} == {'metadata.yaml', 'bag_0.mcap'}
    assert topics(bag) >= {'/tracks', '/camera_info', '/cmd_vel', '/epipoles', '/ground_truth'}
    assert not any(topic.endswith('image_raw') for topic in topics(bag))
    twists = [decoded(message) for message in read_back(bag) if message[0] == '/cmd_vel']
    assert any(twist.linear.x for twist in twists)
    assert all(abs(twist.angular.z) <= 1.668 * abs(twist.linear.x) for twist in twists)
    assert main(['replay', str(bag), '--out', str(tmp_path / 'replayed')]) == 0


def test_a_folder_that_is_no_bag_is_left_alone(tmp_path, capsys) -> None:
    mine = tmp_path / 'out/bag/mine.txt'
    mine.parent.mkdir(parents=True)
    mine.write_text('kept')
    assert demo(tmp_path) == 2
    error = capsys.readouterr().err.splitlines()[-1]
    assert 'must be the bag of an earlier run, to be replaced, but holds mine.txt' in error
    assert mine.read_text() == 'kept'
