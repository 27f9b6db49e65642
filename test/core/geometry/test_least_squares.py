"""Least squares: exact values come back exactly, wrong ones do not count, open columns show."""

import numpy as np

from visual_servo_epipolar.core.geometry.least_squares import (
    gauss_newton,
    linear_fit,
    robust_fit,
    samples,
)


def weigh(residual: np.ndarray) -> np.ndarray:
    return 1.0 / (1.0 + (residual / 0.1) ** 2) ** 2


def test_a_robust_fit_leaves_out_wrong_values_and_tells_columns_that_look_alike() -> None:
    rng = np.random.default_rng(0)
    columns, true = rng.normal(size=(40, 3)), np.array([1.0, -2.0, 0.5])
    values = columns @ true
    values[:6] += 3.0
    fit = robust_fit(columns, values, weigh, 20)
    assert fit is not None and np.allclose(fit.solution, true, atol=1e-3)
    assert robust_fit(columns[:, [0, 1, 0]], values, weigh, 3) is None


def test_one_step_of_gauss_newton_is_the_linear_fit() -> None:
    rng = np.random.default_rng(1)
    columns, values, weight = rng.normal(size=(20, 3)), rng.normal(size=20), rng.random(20)
    fit = linear_fit(columns, values, weight)
    change, information = gauss_newton(columns.T[None], -values[None], weight[None], np.zeros(1))
    assert np.allclose(change[0], fit.solution)
    assert np.allclose(np.linalg.inv(information[0]), fit.covariance())


def test_no_sample_has_one_twice() -> None:
    drawn = samples(np.random.default_rng(2), 50, 9, 5)
    assert drawn.shape == (50, 5) and all(len(set(each)) == 5 for each in drawn.tolist())
