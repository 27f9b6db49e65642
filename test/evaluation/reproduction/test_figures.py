"""The figures are drawn anew, and the data behind them compared with what was stored."""

import json
from pathlib import Path

from matplotlib.figure import Figure
import numpy as np
import pytest

from visual_servo_epipolar.evaluation.reproduction.canvas import figure_data, thin
from visual_servo_epipolar.evaluation.reproduction.chapters import (
    Chapter,
    chapter_1,
    chapter_2,
    data,
)

# Of the largest value of each line: what another BLAS and another compiler may change.
TOLERANCE = 1e-6
REFERENCE = json.loads(Path(__file__).with_name('figures.json').read_text(encoding='utf-8'))


@pytest.fixture(scope='module')
def chapters(runs_1, runs_2) -> dict[str, Chapter]:
    return {'sim1': chapter_1(print, runs_1), 'sim2': chapter_2(print, runs_2)}


@pytest.fixture(scope='module')
def drawn(chapters) -> dict[str, Figure]:
    return {name: figure for c in chapters.values() for name, figure in c.figures.items()}


def test_every_figure_of_the_simulations_is_there(drawn) -> None:
    assert set(drawn) == {*(f'figure_{number:02d}' for number in range(7, 16)), 'sign'}


@pytest.mark.parametrize('name', [*(f'figure_{n:02d}' for n in range(7, 16)), 'sign'])
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


@pytest.mark.parametrize('name', [*(f'figure_{n:02d}' for n in range(7, 16)), 'sign'])
def test_figures_have_units_and_the_number_of_the_paper(drawn, name) -> None:
    figure = drawn[name]
    if name != 'sign':
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


def test_a_chapter_is_titled_by_its_simulation_and_what_its_camera_knows(chapters) -> None:
    assert [chapter.title for chapter in chapters.values()] == [
        'Simulation 1: calibrated camera',
        'Simulation 2: partially calibrated camera',
    ]
