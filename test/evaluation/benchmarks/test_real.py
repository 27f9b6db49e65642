"""Photographs with truth, and what is believed of them."""

import json
import math
from pathlib import Path

import cv2
from inspected import CAMERA, SMALL
import pytest

from visual_servo_epipolar.commands.main import main
from visual_servo_epipolar.core.geometry.epipolar import Bearings
from visual_servo_epipolar.core.geometry.motion import Pose
from visual_servo_epipolar.simulation.camera_simulator import CameraSimulator
from visual_servo_epipolar.simulation.cameras import CameraSettings

PAIRS = Path(__file__).resolve().parents[4] / 'shared' / 'real_pairs'
POSE = Pose.from_start(0.8, -3.0, 10.0)


def bench(folder: Path | str, result: Path) -> tuple[int, list[dict]]:
    code = main(['bench', 'real', str(folder), '--json', str(result)])
    return code, json.loads(result.read_text())['real']['pairs'] if result.exists() else []


def _wrong(row: dict) -> float:
    """Return the error [deg] from which on a pair is wrong, by how well its truth is known."""
    return 3.0 + {'tsdf': 2.0, 'tumfr3': 0.5}.get(row['group'], 0.0)


def test_a_folder_of_photographs_is_judged_by_its_truth(tmp_path: Path, capsys) -> None:
    world = CameraSimulator(CameraSettings(**SMALL))
    cv2.imwrite(str(tmp_path / 'goal.png'), world.photograph())
    cv2.imwrite(str(tmp_path / 'start.png'), world.capture(POSE, 0))
    (tmp_path / 'room.yaml').write_text(CAMERA)
    bearings = Bearings.from_pose(POSE)
    truth = {
        'bearing_current_deg': math.degrees(bearings.current),
        'bearing_desired_deg': math.degrees(bearings.desired),
        'rotation_deg': 10.0,
    }
    files = {'desired': 'goal.png', 'current': 'start.png', 'camera': 'room.yaml'}
    (tmp_path / 'truth.json').write_text(json.dumps([{'name': 'a', **files, 'truth': truth}]))
    code, (row,) = bench(tmp_path, tmp_path / 'result.json')
    assert code == 0
    assert (row['trusted'], row['group']) == (True, 'room')
    assert row['error_deg'] < 0.3
    assert row['peers_deg']['MAGSAC'] < 3.0
    printed = capsys.readouterr().out
    assert 'room' in printed and 'deviation_deg 0 to 0.4' in printed


@pytest.mark.parametrize(
    ('name', 'text', 'words'),
    [
        ('real', None, 'No such file'),
        ('real', '{', 'must be JSON'),
        ('real', '[]', 'must be a list of pairs'),
        ('real', '[{"name": "a"}]', 'a pair must have name, desired, current, camera and truth'),
        ('routes', '[]', 'must name recorded ways'),
        (
            'routes',
            '{"hall": {"kind": "clip"}}',
            'hall must have kind, camera, two frames or more',
        ),
    ],
)
def test_a_folder_without_truth_is_bad_input(tmp_path, capsys, name, text, words) -> None:
    if text is not None:
        (tmp_path / 'truth.json').write_text(text)
    assert main(['bench', name, str(tmp_path)]) == 2
    errors = capsys.readouterr().err
    assert words in errors and errors.count('\n') == 1


@pytest.mark.skipif(not PAIRS.is_dir(), reason=f'{PAIRS.name} of photographs is not there')
def test_real_photographs_are_believed_where_they_are_right(tmp_path: Path) -> None:
    code, rows = bench(PAIRS, tmp_path / 'result.json')
    assert code == 0
    wrong = [row['name'] for row in rows if row['trusted'] and row['error_deg'] > _wrong(row)]
    assert not wrong
    peers = [(row['peers_deg']['MAGSAC'], row['trusted']) for row in rows]
    right = [trusted for error, trusted in peers if error is not None and error <= 3.0]
    assert sum(right) >= len(right) - 1  # 7 of 8: the eighth has a parallax of 2.3 px
