"""The paper's simulations anew: their outcome, figures and command."""

from dataclasses import replace
import json
from pathlib import Path

from command_line import refusal
import cv2
from matplotlib.figure import Figure
import numpy as np
import pytest

from visual_servo_epipolar.commands.main import main
from visual_servo_epipolar.core.geometry.motion import Pose
from visual_servo_epipolar.evaluation.reproduction.chapters import (
    Chapter,
    chapter_1,
    chapter_2,
    data,
)
from visual_servo_epipolar.evaluation.reproduction.continuous import (
    PointCamera,
    run,
    SIMULATION_1,
)
from visual_servo_epipolar.evaluation.reproduction.paper import decay, figure_data, thin
from visual_servo_epipolar.evaluation.reproduction.simulations import claims_1, claims_2


def test_numbers_are_those_of_the_paper() -> None:
    case = SIMULATION_1
    assert (case.focal, case.k1, case.k2, case.k_t) == (0.03, 0.5, 0.5, 100.0)
    assert (case.exponent, case.initial_distance, case.tolerance) == (5 / 9, 2.0, 1e-9)
    assert (case.start.x, case.start.y, np.degrees(case.start.theta)) == (1.0, 1.0, 90.0)
    assert len(PointCamera(0.03, 0.03).points) == 8


def test_printed_sign_fails_behind_the_goal_where_the_true_one_arrives(runs_1) -> None:
    assert runs_1.behind_printed.outcome == 'e_au passed through infinity'
    assert runs_1.behind_corrected.outcome == 'arrived'
    np.testing.assert_allclose(
        runs_1.behind_corrected.column('pose.y', 1),
        -runs_1.corrected.column('pose.y', 1),
        atol=1e-6,
    )


def test_guess_that_sends_the_robot_among_the_points_is_reported() -> None:
    wild = run(replace(SIMULATION_1, initial_distance=20.0))
    assert wild.outcome == 'a point left the half-space before the camera'
    assert np.isnan(wild.zeroed_at)


def test_claims_disagree_where_the_paper_is_wrong_and_nowhere_else(runs_1, runs_2) -> None:
    statements = [*claims_1(runs_1), *claims_2(runs_2)]
    wrong = [s.place for s in statements if s.agrees is False]
    assert wrong == ['sign', 'sign', 'VI, end']
    assert all(s.agrees is not None or 'no number' in s.paper for s in statements)


def test_point_behind_the_camera_is_no_image() -> None:
    assert np.isnan(PointCamera(0.03, 0.03).image(Pose(0.0, 8.0, np.pi / 2))).any()


def test_a_decay_is_found() -> None:
    time = np.linspace(0.0, 5.0, 50)
    fit = decay(time, -3.0 * np.exp(-0.7 * time))
    assert (fit.rate, fit.initial) == (pytest.approx(0.7), pytest.approx(3.0))
    np.testing.assert_allclose(fit.at(time), 3.0 * np.exp(-0.7 * time))
    with pytest.raises(ValueError, match='three values'):
        decay(time, 0.0 * time)


def test_simulation_2_writes_figures_table_data_and_json(tmp_path, capsys) -> None:
    out, result = tmp_path / 'out', tmp_path / 'result.json'
    assert main(['reproduce', 'sim2', '--out', str(out), '--json', str(result)]) == 0
    assert {path.name for path in out.iterdir()} == {
        *('figure_14.png', 'figure_15.png', 'figures.json', 'table.md')
    }
    assert all(cv2.imread(str(path)).std() > 0.0 for path in out.glob('*.png'))
    assert set(json.loads((out / 'figures.json').read_text())) == {'figure_14', 'figure_15'}
    document = json.loads(result.read_text())['sim2']
    assert document['succeeded'] is True
    assert document['numbers']['course']['outcome'] == 'arrived'
    table = (out / 'table.md').read_text()
    assert all(f'| {s["place"]} |' in table for s in document['statements'])
    assert 'DISAGREES' in capsys.readouterr().out


@pytest.mark.parametrize(
    ('arguments', 'reason'),
    [
        (['sim3', '--out', 'x'], 'invalid choice'),
        (['sim1'], 'required: --out'),
        (['sim1', '--out', '/dev/null/x'], 'nothing can be written there'),
    ],
)
def test_bad_usage_is_one_line(capsys, arguments, reason) -> None:
    assert reason in refusal(capsys, 'reproduce', *arguments)


# Of the largest value of each line: what another BLAS and another compiler may change.
TOLERANCE = 1e-6
REFERENCE = json.loads(Path(__file__).with_name('figures.json').read_text(encoding='utf-8'))


@pytest.fixture(scope='module')
def chapters(runs_1, runs_2) -> dict[str, Chapter]:
    return {'sim1': chapter_1(print, runs_1), 'sim2': chapter_2(print, runs_2)}


@pytest.fixture(scope='module')
def drawn(chapters) -> dict[str, Figure]:
    return {name: figure for c in chapters.values() for name, figure in c.figures.items()}


@pytest.mark.parametrize('name', [f'figure_{n:02d}' for n in range(7, 16)])
def test_the_data_behind_a_figure_are_those_stored(chapters, name) -> None:
    current, stored = data(chapters)[name], REFERENCE[name]
    assert current.keys() == stored.keys()
    for line in current:
        expected = np.array(stored[line])
        scale = np.abs(expected).max(axis=0)
        assert len(current[line]) == len(expected), line
        assert (np.abs(np.array(current[line]) - expected) <= TOLERANCE * scale + 1e-12).all(), (
            line
        )


@pytest.mark.parametrize('name', [f'figure_{n:02d}' for n in range(7, 16)])
def test_figures_have_units_and_the_number_of_the_paper(drawn, name) -> None:
    figure = drawn[name]
    assert figure.texts[0].get_text().startswith(f'Fig. {int(name[-2:])} ')
    for axes in figure.axes:
        assert axes.get_xlabel().endswith(']') and axes.get_ylabel().endswith(']')
        sizes = [text.get_fontsize() for text in (axes.xaxis.label, axes.yaxis.label)]
        assert min(sizes) >= 8.0  # points, on a page as wide as the figure
    assert figure.get_size_inches()[0] <= 7.2


def test_data_are_what_is_drawn_and_keep_both_ends() -> None:
    axes = Figure().subplots()
    x = np.linspace(0.0, 1.0, 1001)
    axes.plot(x, x**2, label='a')
    axes.axhline(1.0)  # no label: an aid to the eye
    current = thin(figure_data(axes.figure), 11)
    assert list(current) == ['0: a']
    np.testing.assert_allclose(current['0: a'], np.stack([x, x**2], axis=1)[::100])
