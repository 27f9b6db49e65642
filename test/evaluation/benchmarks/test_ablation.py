"""The ablation benchmark: which laws it compares, and the rows that it makes of their runs."""

from dataclasses import replace
import json
import math
from typing import Any

import pytest

from visual_servo_epipolar.core.estimate.settings import DEPARTURES
from visual_servo_epipolar.core.laws.registry import LAWS
from visual_servo_epipolar.core.servo.settings import ServoSettings
from visual_servo_epipolar.evaluation.benchmarks import ablation
from visual_servo_epipolar.sweeping.summary import summary_of

FAILURE = {'outcome': 'failed', 'reason': 'tracks lost for 5 s'}
NAN_AND_NONE = [math.nan, None]


@pytest.fixture(scope='module')
def document() -> dict[str, Any]:
    return ablation.run(seed=0, quick=True, say=lambda text: None)


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


def test_a_quick_run_has_a_row_for_each_of_its_laws(document: dict[str, Any]) -> None:
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


def test_the_table_has_a_line_for_each_row(document: dict[str, Any]) -> None:
    lines = ablation.table(document).splitlines()
    assert lines[0].startswith('1 starts a region')
    cells = [line.split(' | ') for line in lines[4:]]
    assert [row[0] for row in cells] == [f'| {law}' for law in ablation.QUICK_LAWS]
    assert len({len(row) for row in cells}) == 1
    assert cells[0][2] == '100 %'


@pytest.mark.parametrize('missing', NAN_AND_NONE, ids=str)
def test_a_law_of_which_no_run_arrived_has_dashes(document, missing) -> None:
    row = {'law': 'paper', 'region': 'front'} | summary_of([FAILURE, FAILURE])
    assert math.isnan(row['position_error_m']['median'])
    for name in ('position_error_m', 'heading_error_deg', 'max_distance_ratio', 'duration_s'):
        row[name] = dict.fromkeys(row[name], missing)
    line = ablation.table({**document, 'rows': [row]}).splitlines()[-1]
    assert line == '| paper | front | 0 % | 0 | - / - | - | - | - |'
