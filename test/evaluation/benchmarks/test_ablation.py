"""The ablation benchmark: which laws it compares, and the rows that it makes of their runs."""

from importlib.metadata import EntryPoint
import json
import math
from typing import Any

import pytest

from visual_servo_epipolar.core import registry
from visual_servo_epipolar.core.estimate.settings import DEPARTURES
from visual_servo_epipolar.core.laws.registry import law_named, LAWS, PAPER
from visual_servo_epipolar.evaluation.benchmarks import ablation
from visual_servo_epipolar.sweeping.summary import summary_of

GROUP = 'visual_servo_epipolar.laws'
SAME_AS_OURS = PAPER
FAILURE = {'outcome': 'failed', 'reason': 'tracks lost for 5 s'}
NAN_AND_NONE = [math.nan, None]


@pytest.fixture(scope='module')
def document() -> dict[str, Any]:
    return ablation.run(seed=0, quick=True, say=lambda text: None)


def test_every_departure_is_left_out_of_full_once() -> None:
    left_out = [law for law in ablation.laws() if law.startswith('full-')]
    assert left_out == [f'full-{name}' for name in DEPARTURES]


def test_every_departure_stands_alone_on_the_paper_once() -> None:
    paper = law_named('paper')
    alone = [paper.changed({name: not getattr(paper, name)}) for name in DEPARTURES]
    compared = [law_named(law) for law in ablation.laws()]
    assert [compared.count(law) for law in alone] == [1] * len(DEPARTURES)


def test_no_law_is_compared_twice_under_two_names() -> None:
    laws = ablation.laws()
    assert len({law_named(law) for law in laws}) == len(laws) == 2 * (1 + len(DEPARTURES))


def test_paper_with_the_true_sigma_is_named_corrected() -> None:
    assert ablation._known('paper+true_sigma') == 'corrected'
    assert 'corrected' in ablation.laws()
    assert 'paper+true_sigma' not in ablation.laws()


def test_laws_of_other_packages_neither_load_nor_name_a_row(monkeypatch) -> None:
    before = ablation.laws()
    points = [
        EntryPoint('broken', 'math:no_such_thing', GROUP),
        EntryPoint('ours', f'{__name__}:SAME_AS_OURS', GROUP),
    ]
    monkeypatch.setattr(registry, 'entry_points', lambda group: points)
    assert list(LAWS)[-2:] == ['broken', 'ours']
    assert ablation.laws() == before


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
    assert [row[0] for row in cells] == [f'| `{law}`' for law in ablation.QUICK_LAWS]
    assert len({len(row) for row in cells}) == 1
    assert cells[0][2] == '100 %'


@pytest.mark.parametrize('missing', NAN_AND_NONE, ids=str)
def test_a_law_of_which_no_run_arrived_has_dashes(document, missing) -> None:
    row = {'law': 'paper', 'region': 'front'} | summary_of([FAILURE, FAILURE])
    assert math.isnan(row['position_error_m']['median'])
    for name in ('position_error_m', 'heading_error_deg', 'max_distance_ratio', 'duration_s'):
        row[name] = dict.fromkeys(row[name], missing)
    line = ablation.table({**document, 'rows': [row]}).splitlines()[-1]
    assert line == '| `paper` | front | 0 % | 0 | - / - | - | - | - |'
