"""Least squares: exact values come back exactly, wrong ones do not count, open columns show."""

import numpy as np

from visual_servo_epipolar.core.geometry.least_squares import (
    Damped,
    Equations,
    least_squares,
    linear_fit,
    null_vector,
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
    rows = np.column_stack([-values, columns]).T * np.sqrt(weight)
    equations = Equations.of(rows[None])
    assert np.allclose(-equations.change()[0], fit.solution)
    assert np.allclose(np.linalg.inv(equations.information[0]), fit.covariance())


def test_steps_end_at_the_least_squares_and_damped_ones_are_shorter() -> None:
    def linearise(angle: np.ndarray, number: int) -> Equations:
        (sine,), (cosine,) = np.sin(angle), np.cos(angle)
        return Equations.of(np.array([[cosine - 0.6, sine - 0.8], [-sine, cosine]]))

    def moved(angle: np.ndarray, at: Equations, change: np.ndarray) -> tuple[np.ndarray, bool]:
        return angle - change, abs(float(change[0])) < 1e-12

    angle, last = least_squares(np.array([0.2]), linearise, moved, 20)
    assert np.allclose(angle, np.arctan2(0.8, 0.6)) and np.allclose(last.information, 1.0)
    first = linearise(np.array([0.2]), 0)
    assert np.allclose(Damped(first, 1.0).change(), 0.5 * first.change())


def test_singular_equations_are_nan_and_spare_their_neighbours() -> None:
    both = Equations(np.stack([np.zeros((2, 2)), np.eye(2)]), np.ones((2, 2)))
    assert np.isnan(both.change()[0]).all() and (both.change()[1] == 1.0).all()


def test_no_sample_has_one_twice() -> None:
    drawn = samples(np.random.default_rng(2), 50, 9, 5)
    assert drawn.shape == (50, 5) and all(len(set(each)) == 5 for each in drawn.tolist())


def test_a_null_vector_is_that_of_the_rows_that_count() -> None:
    rows, null = np.random.default_rng(3).normal(size=(12, 4)), np.array([0.5, -0.5, 0.5, 0.5])
    rows -= np.outer(rows @ null, null)
    rows[0] = null
    found = null_vector(rows, np.arange(12) > 0)
    assert np.allclose(np.abs(found @ null), 1.0)
    assert np.allclose(null_vector(np.stack([rows[1:], rows[1:]])) @ null, found @ null)
