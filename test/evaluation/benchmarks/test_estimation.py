"""The estimation benchmark runs, and measures what it says."""

import math

import numpy as np
import pytest

from visual_servo_epipolar.core.geometry.epipolar import (
    Bearings,
    fundamental_from_bearings,
    sampson_distance,
)
from visual_servo_epipolar.evaluation.benchmarks import estimation
from visual_servo_epipolar.evaluation.benchmarks.scenes import (
    Cell,
    draw_pair,
    draw_pairs,
    error,
)


@pytest.mark.parametrize('noise', [0.0, 0.3])
def test_pairs_obey_the_geometry_they_are_drawn_from(noise: float) -> None:
    cell = Cell(baseline=3.0, noise=noise)
    for pair in draw_pairs(cell, 5, 1):
        fundamental = fundamental_from_bearings(pair.bearings)
        distance = sampson_distance(fundamental, pair.current, pair.desired)
        rms = float(np.sqrt((distance**2).mean()))
        assert 0.5 * cell.ray_noise <= rms < 1.5 * cell.ray_noise + 1e-12


def test_the_same_seed_draws_the_same_pairs() -> None:
    one, other = (draw_pairs(Cell(baseline=1.0), 3, 7) for _ in range(2))
    np.testing.assert_array_equal(one[2].current, other[2].current)


def test_outliers_are_as_many_as_asked_for() -> None:
    pair = draw_pair(Cell(baseline=3.0, outliers=0.2), np.random.default_rng(0))
    true = fundamental_from_bearings(pair.bearings)
    distance = sampson_distance(true, pair.current, pair.desired)
    assert int((np.abs(distance) > 4.0 * 0.3 / 770.0).sum()) <= 5
    assert float(np.abs(distance[5:]).max()) < 4.5 * 0.3 / 770.0


def test_the_error_is_that_of_the_axes() -> None:
    true = Bearings(-1.5, 3.0)
    assert error(true.reversed(), true) == pytest.approx(0.0, abs=1e-9)
    found = Bearings(-1.5 + math.radians(1.0), 3.0 - math.radians(1.0))
    assert error(found, true) == pytest.approx(1.0)


@pytest.fixture(scope='module')
def document() -> dict[str, object]:
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(estimation, 'QUICK_TRIALS', 3)
        patch.setattr(estimation, 'BASELINES', (3.0, 1.5, 0.75, 0.4))
        return estimation.run(seed=1, quick=True, say=lambda _: None)


def test_the_benchmark_runs_and_prints_its_tables(document: dict[str, object]) -> None:
    text = estimation.table(document)
    for heading in ('ideal', 'realistic', 'one wall', 'reversed', 'time, '):
        assert heading in text
    assert 'opencv LMedS F' in text


def test_without_poselib_the_table_names_the_rows_left_out(document, monkeypatch) -> None:
    versions = {**document['versions'], 'poselib': None}
    text = estimation.table({**document, 'versions': versions})
    assert 'poselib is not installed: its rows are left out' in text
    monkeypatch.setattr(estimation, 'find_spec', lambda _: None)
    assert set(estimation.peers()) == {'opencv LMedS F', 'opencv MAGSAC F'}
