"""Recorded ways with truth: what is learnt of them, and whether frames of them are found."""

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from visual_servo_epipolar.commands.main import main

DONKEY = Path(__file__).parent / 'donkey'
REAL = Path(__file__).resolve().parents[4] / 'shared' / 'real_clips'


def bench(folder: Path, result: Path) -> tuple[int, dict[str, Any]]:
    code = main(['bench', 'routes', str(folder), '--json', str(result)])
    return code, json.loads(result.read_text())['routes'] if result.exists() else {}


def count(document: dict[str, Any], outcome: str) -> int:
    return sum(it['outcome'] == outcome for way in document['ways'] for it in way['frames'])


def test_a_way_of_a_race_car_is_taught_and_its_frames_are_found(tmp_path, capsys) -> None:
    code, document = bench(DONKEY, tmp_path / 'result.json')
    assert code == 0 and document['ways'][0]['taught']
    assert count(document, 'found') == 6
    assert not any(row['trusted'] for row in document['bearings'])  # 1 px of parallax
    printed = capsys.readouterr().out
    assert 'donkey_route' in printed and 'matches 70 to 120' in printed


@pytest.mark.skipif(not REAL.is_dir(), reason=f'{REAL.name} is not there: not to be committed')
def test_real_ways_are_taught_and_frames_are_found_where_they_were_taken(tmp_path: Path) -> None:
    code, document = bench(REAL, tmp_path / 'result.json')
    assert code == 0 and all(way['taught'] for way in document['ways'])
    assert count(document, 'found') >= 11 and count(document, 'wrong') == 0
    assert not any(way['elsewhere']['found'] for way in document['ways'])
    rows = [it for it in document['bearings'] if it['trusted']]
    deviations = [(it['error_deg'], it['deviation_deg']) for it in rows]
    assert np.percentile([error / deviation for error, deviation in deviations], 95) < 3.0
    pair = next(it for it in document['bearings'] if it['name'] == 'picar_pair_wrong')
    assert not pair['trusted'] or pair['error_deg'] < 3.0
