"""Photographs and recorded ways with truth: what is believed and learnt of them, and found."""

import json
import math
from pathlib import Path
from typing import Any

import cv2
from inspected import CAMERA, SMALL
import numpy as np
import pytest

from visual_servo_epipolar.commands.main import main
from visual_servo_epipolar.core.geometry.epipolar import Bearings
from visual_servo_epipolar.core.geometry.motion import Pose
from visual_servo_epipolar.simulation.camera_simulator import CameraSimulator
from visual_servo_epipolar.simulation.cameras import CameraSettings

SHARED = Path(__file__).resolve().parents[4] / 'shared'
PAIRS, REAL = SHARED / 'real_pairs', SHARED / 'real_clips'
DONKEY = Path(__file__).parent / 'donkey'
POSE = Pose.from_start(0.8, -3.0, 10.0)


def bench(name: str, folder: Path, result: Path) -> dict[str, Any]:
    assert main(['bench', name, str(folder), '--json', str(result)]) == 0
    return json.loads(result.read_text())[name]


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
    (row,) = bench('real', tmp_path, tmp_path / 'result.json')['pairs']
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
    rows = bench('real', PAIRS, tmp_path / 'result.json')['pairs']
    wrong = [row['name'] for row in rows if row['trusted'] and row['error_deg'] > _wrong(row)]
    assert not wrong
    peers = [(row['peers_deg']['MAGSAC'], row['trusted']) for row in rows]
    right = [trusted for error, trusted in peers if error is not None and error <= 3.0]
    assert sum(right) >= len(right) - 1  # 7 of 8: the eighth has a parallax of 2.3 px


def count(document: dict[str, Any], outcome: str) -> int:
    return sum(it['outcome'] == outcome for way in document['ways'] for it in way['frames'])


def test_a_way_of_a_race_car_is_taught_and_its_frames_are_found(tmp_path, capsys) -> None:
    document = bench('routes', DONKEY, tmp_path / 'result.json')
    assert document['ways'][0]['taught']
    assert count(document, 'found') == 6
    assert not any(row['trusted'] for row in document['bearings'])  # 1 px of parallax
    printed = capsys.readouterr().out
    assert 'donkey_route' in printed and 'matches 70 to 120' in printed


@pytest.mark.skipif(not REAL.is_dir(), reason=f'{REAL.name} is not there: not to be committed')
def test_real_ways_are_taught_and_frames_are_found_where_they_were_taken(tmp_path: Path) -> None:
    document = bench('routes', REAL, tmp_path / 'result.json')
    assert all(way['taught'] for way in document['ways'])
    assert count(document, 'found') >= 11 and count(document, 'wrong') == 0
    assert not any(way['elsewhere']['found'] for way in document['ways'])
    rows = [it for it in document['bearings'] if it['trusted']]
    deviations = [(it['error_deg'], it['deviation_deg']) for it in rows]
    assert np.percentile([error / deviation for error, deviation in deviations], 95) < 3.0
    pair = next(it for it in document['bearings'] if it['name'] == 'picar_pair_wrong')
    assert not pair['trusted'] or pair['error_deg'] < 3.0
