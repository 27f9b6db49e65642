"""The map and the table of a sweep hold its runs, with units, law by law."""

from pathlib import Path
from typing import Any

from matplotlib.axes import Axes
from matplotlib.collections import PathCollection
import numpy as np
import pytest
from sweeps import filled, plan_of, result

from visual_servo_epipolar.report import sweep_report
from visual_servo_epipolar.sweeping.summary import summaries

FAILED = {'outcome': 'failed', 'reason': 'ran | away in 3.5 s'}
RUNS = {
    'paper': [result(start=[0.1 * k, -2.0, 5.0 * k], **FAILED) for k in range(3)],
    'full': [
        result(start=[0.0, -2.0, 0.0], position_error_m=0.0),
        result(start=[0.1, -2.0, 90.0], position_error_m=0.001),
        result(start=[0.2, -2.0, 10.0], position_error_m=0.2),
        result(start=[0.3, -2.0, 10.0], traceback='Traceback', **FAILED),
    ],
}
UNSEEN = result(outcome='failed', reason='defect: x', position_error_m=None, traceback='x')
CORNERS = (-1.0, 4.0), (1.0, -4.0)


@pytest.fixture
def documents(tmp_path: Path) -> dict[str, Any]:
    documents = {}
    for law, runs in RUNS.items():
        plan = plan_of(len(runs), laws=(law,))
        with filled(tmp_path / law, plan, runs) as store:
            documents.update(summaries(plan, store))
    return documents


def drawn(axes: Axes, marker_points: int) -> list[list[float]]:
    """Return the places of the groups of markers that have so many points."""
    groups = [item.get_offsets() for item in axes.collections if type(item) is PathCollection]
    return [np.asarray(group).tolist() for group in groups if len(group) == marker_points]


def test_each_law_has_a_map_in_metres_and_all_starts_are_on_it(documents: dict[str, Any]) -> None:
    paper, full, bar = sweep_report.starts(documents).axes
    assert (paper.get_xlabel(), paper.get_ylabel()) == ('x [m]', 'y [m]')
    assert (paper.get_xlim(), paper.get_ylim()) == (full.get_xlim(), full.get_ylim())
    assert paper.get_aspect() == 1.0
    arrived = next(item for item in full.collections if item.get_array() is not None)
    assert arrived.get_array().tolist() == [0.0, 1.0]
    assert '[mm]' in bar.get_ylabel()
    assert (paper.get_title(loc='left'), full.get_title(loc='left')) == (
        'law paper: 0 of 3 arrived',
        'law full: 3 of 4 arrived\nmedian 1 mm, p95 180 mm',
    )
    assert drawn(paper, 3) == [[run['start'][:2] for run in RUNS['paper']]]
    # Two that are where they say, one that is not, one that raised.
    assert drawn(full, 2) == [[[0.0, -2.0], [0.1, -2.0]]]
    assert drawn(full, 1) == [[[0.2, -2.0]], [[0.3, -2.0]]]


def test_no_title_is_cut(documents: dict[str, Any]) -> None:
    around = [run | {'start': [4.0 * x, y, 0.0]} for run in RUNS['full'] for x, y in CORNERS]
    figure = sweep_report.starts({'full': documents['full'] | {'runs': around}})
    figure.canvas.draw()
    top = figure.axes[0].get_tightbbox(figure.canvas.get_renderer()).y1
    assert top <= figure.bbox.height


@pytest.mark.parametrize('runs', [[UNSEEN], [result()], [result(position_error_m=0.0)]])
def test_the_smallest_of_sweeps_can_be_drawn(tmp_path: Path, runs: list[dict[str, Any]]) -> None:
    plan = plan_of(1)
    with filled(tmp_path, plan, runs) as store:
        figure = sweep_report.starts(summaries(plan, store))
    figure.canvas.draw()


def cells(text: str, first: str) -> list[str]:
    """Return the cells of the row that begins with ``first``."""
    row = next(line for line in text.splitlines() if line.startswith(f'| {first} '))
    return [cell.strip() for cell in row.strip('|').replace('\\|', '!').split('|')][1:]


def test_the_table_says_what_the_runs_say(documents: dict[str, Any], tmp_path: Path) -> None:
    text = sweep_report.table(documents)
    assert cells(text, 'arrived') == ['0 % (0 of 3)', '75 % (3 of 4)']
    assert cells(text, 'arrived but wrong') == ['0', '1']
    assert cells(text, 'raised') == ['0', '1']
    spreads = cells(text, 'position error, median / p95 / max [mm]')
    assert spreads == ['- / - / -', '1.00 / 180 / 200']
    assert cells(text, 'heading error [deg]')[1] == '0.0500 / 0.0500 / 0.0500'
    assert cells(text, 'ran \\| away in N s') == ['3', '1']
    assert documents['paper']['sweep']['command'] in text
    lost = result(max_distance_ratio=5.0, wrong_geometry_s=30.0, **FAILED)
    plan = plan_of(2)
    with filled(tmp_path / 'lost', plan, [result(), lost]) as store:
        text = sweep_report.table(summaries(plan, store))
    assert cells(text, 'the same, all runs') == ['3.00 / 4.80 / 5.00']
    assert cells(text, 'wrong geometry, all runs [s]') == ['15.0 / 28.5 / 30.0']
