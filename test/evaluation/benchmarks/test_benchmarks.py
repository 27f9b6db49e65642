"""Benchmarks of camera matrices, departures, consistency; the report of all; the command line."""

from dataclasses import replace
import json
import math
from pkgutil import resolve_name
import subprocess
import sys

import numpy as np
import pytest
from servo_states import reading, SETTINGS, sight

from visual_servo_epipolar.commands.main import parser
from visual_servo_epipolar.core.errors import InputError
from visual_servo_epipolar.core.estimate.goal_estimate import BaseModel, goal_estimate
from visual_servo_epipolar.core.estimate.settings import DEPARTURES
from visual_servo_epipolar.core.geometry.motion import Pose
from visual_servo_epipolar.core.laws.registry import LAWS
from visual_servo_epipolar.core.servo.settings import ServoSettings
from visual_servo_epipolar.evaluation.benchmarks import ablation, calibration, consistency, report
from visual_servo_epipolar.evaluation.benchmarks.command import BENCHMARKS, FOLDERS
from visual_servo_epipolar.simulation.scenario import Scenario


@pytest.mark.long
def test_the_camera_matrix_is_found_out_where_believing_it_fails() -> None:
    document = calibration.run(seed=0, quick=True, say=lambda _: None)
    rows = {row['method']: row for row in document['rows']}
    assert rows['found out']['arrived'] == len(rows['found out']['runs']) == 2
    assert rows['found out']['position_error_m']['max'] < 0.01
    assert rows['believed']['arrived'] < 2
    text = calibration.table(document)
    assert text.count('above the axle') == text.count('0.25') == 2


def test_each_departure_is_left_out_of_full_and_added_to_the_paper_once() -> None:
    laws, options = ablation.laws(), {}
    for name, taken in laws.items():
        options[name] = ServoSettings(**taken).options
    assert (options['full'], options['paper']) == (LAWS['full'], LAWS['paper'])
    assert options['full without retreat'] == replace(LAWS['full'], retreat=False)
    assert options['paper with true_sigma'] == LAWS['corrected']
    assert len(laws) == len(set(options.values())) == 2 * (1 + len(DEPARTURES))
    # Each row but the first two differs from its law in one departure.
    for name, row in options.items():
        law = options[name.split()[0]]
        differing = [it for it in DEPARTURES if getattr(row, it) != getattr(law, it)]
        assert differing == name.split()[2:]


def test_a_quick_run_has_a_row_for_each_of_its_laws() -> None:
    document = ablation.run(seed=0, quick=True, say=lambda text: None)
    rows = document['rows']
    assert [(row['law'], row['region']) for row in rows] == [
        (law, 'front') for law in ablation.QUICK_LAWS
    ]
    assert document['starts'] == 1
    assert document['departures'] == DEPARTURES
    assert not any('runs' in row for row in rows) and json.dumps(document)
    full, without_retreat, _ = rows
    # Point features from the front: full always arrives, and has nothing to retreat from.
    assert full['success_rate'] == without_retreat['success_rate'] == 1.0
    assert full['arrived_but_wrong'] == 0
    lines = ablation.table(document).splitlines()
    assert [line.split(' | ')[0] for line in lines[4:]] == [
        f'| {it}' for it in ablation.QUICK_LAWS
    ]


SCENARIO = Scenario()
POSE = Pose.from_start(0.2, -1.0, 10.0)


def test_errors_of_as_many_deviations_in_each_part_are_that_squared() -> None:
    covariance, known = np.diag([0.01, 0.02, 0.003]) ** 2, SETTINGS.extrinsics
    exact = replace(known, covariance=np.zeros_like(known.covariance))
    seen = replace(
        sight(),
        offset=(POSE.x + 0.02, POSE.y - 0.04),
        heading_error=POSE.heading_error + 0.009 + 2.0 * math.pi,
    )
    said = goal_estimate(seen, reading(pose_covariance=covariance), exact, BaseModel())
    assert consistency.ratios(said, POSE) == pytest.approx([(4.0 + 4.0 + 9.0) / 3.0, 4.0, 9.0])


def test_each_run_has_a_world_of_its_own_as_the_servo_expects_them() -> None:
    worlds = [consistency.drawn(SCENARIO, seed) for seed in range(200)]
    mounts = [[it.camera.mount_yaw, it.camera.mount_forward, it.base.slip] for it in worlds]
    root = np.sqrt(np.mean(np.square(mounts), axis=0))
    servo = SCENARIO.servo
    expected = [servo.camera_yaw_deviation, servo.camera_forward_deviation, 0.05]
    assert root == pytest.approx(expected, rel=0.2)
    assert consistency.drawn(SCENARIO, 3) == worlds[3]


def test_its_table_has_a_row_for_each_law_and_counts_images_after_the_first_second() -> None:
    document = consistency.run(seed=0, quick=True, say=lambda text: None)
    assert [row['law'] for row in document['rows']] == list(consistency.LAWS)
    assert all(row['images'] > 10 and row['nees'][0] > 0.0 for row in document['rows'])
    lines = consistency.table(document).splitlines()
    assert len(lines) == 4 + len(consistency.LAWS)


SWEEP = 'sweep --region front --runs 1 --seed 3 --jobs 1 --out {out}'


@pytest.mark.parametrize('name', report.COMMANDS)
@pytest.mark.parametrize('form', [str, report.shorter])
def test_each_of_its_commands_is_understood_and_writes_where_it_is_to(name: str, form) -> None:
    words = form(report.COMMANDS[name]).format(out='here').split()
    options = parser(words).parse_args(words)
    assert callable(options.run)
    assert str(getattr(options, 'out', 'here')) == 'here'


def test_it_goes_on_after_a_command_that_cannot_work_and_keeps_what_ended(tmp_path) -> None:
    said: list[str] = []
    asked = {'seed': 0, 'quick': True, 'say': said.append, 'out': str(tmp_path)}
    with pytest.raises(InputError, match='nowhere ended with code 2'):
        report.run(**asked, commands={'first': SWEEP, 'second': 'replay nowhere'})
    document = report.run(**asked, commands={'first': SWEEP, 'second': 'gains --help'})
    assert len(said) == 3
    page = (tmp_path / 'results.md').read_text()
    assert page == report.table(document)
    for words in ('## first', '`visual_servo sweep --region front', '1 of 1', '## second'):
        assert words in page


LOADED = """
import sys
from visual_servo_epipolar.commands.main import parser
WORDS = ['simulate', '--start', '0', '-1', '0']
parser(WORDS).parse_args(WORDS)
print(*[name for name in sys.modules if name.startswith('visual_servo_epipolar.evaluation')])
"""


def test_another_command_loads_nothing_of_the_evaluation() -> None:
    ended = subprocess.run([sys.executable, '-c', LOADED], capture_output=True, text=True)
    assert (ended.returncode, ended.stdout.strip()) == (0, ''), ended.stderr


@pytest.mark.parametrize('name', BENCHMARKS)
def test_each_benchmark_is_a_row_that_runs_and_prints(name: str) -> None:
    row = resolve_name(BENCHMARKS[name])
    assert callable(row.run) and callable(row.table)
    assert set(FOLDERS) <= set(BENCHMARKS)
