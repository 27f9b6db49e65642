"""Intervals against those of scipy, and what they must be whatever the data."""

import math

from hypothesis import given
from hypothesis import strategies as st
import numpy as np
import pytest
from scipy import stats

from visual_servo_epipolar.sweeping.summary import quantile, quantile_interval, wilson

VALUES = st.lists(st.floats(0.0, 1e6), min_size=1, max_size=40)


@given(st.integers(1, 2000), st.data())
def test_wilson_is_that_of_scipy(trials: int, data: st.DataObject) -> None:
    successes = data.draw(st.integers(0, trials))
    theirs = stats.binomtest(successes, trials).proportion_ci(method='wilson')
    assert wilson(successes, trials) == pytest.approx((theirs.low, theirs.high), abs=1e-9)


def test_nothing_is_known_without_a_trial() -> None:
    assert wilson(0, 0) == (0.0, 1.0)
    assert math.isnan(quantile([], 0.95))
    assert all(math.isnan(end) for end in quantile_interval([], 0.95))


@given(VALUES, st.sampled_from([0.5, 0.95]))
def test_an_interval_lies_within_the_data_and_is_repeatable(
    values: list[float], share: float
) -> None:
    low, high = quantile_interval(values, share)
    assert min(values) <= low <= high <= max(values)
    assert (low, high) == quantile_interval(values, share)


def test_the_bootstrap_is_that_of_scipy() -> None:
    values = np.random.default_rng(3).random(300)
    ours = quantile_interval(values, 0.95)
    theirs = stats.bootstrap(
        (values,),
        lambda data, axis: np.quantile(data, 0.95, axis=axis),
        n_resamples=4000,
        method='percentile',
        random_state=np.random.default_rng(5),
    ).confidence_interval
    # Both are drawn: they may differ by a neighbour or two, which are 1/300 apart.
    assert ours == pytest.approx((theirs.low, theirs.high), abs=0.01)


def test_large_data_are_drawn_in_blocks() -> None:
    values = np.random.default_rng(3).random(3001)  # 1000 resamples are more than a block
    low, high = quantile_interval(values, 0.95)
    # Two deviations of the 95th percentile of so many: sqrt(0.95 * 0.05 / 3001) = 0.004.
    assert (low, high) == pytest.approx((0.942, 0.958), abs=0.005)
