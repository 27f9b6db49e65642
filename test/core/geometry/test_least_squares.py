"""Least squares, and chance told from geometry."""

import math

from hypothesis import given, settings
from hypothesis import strategies as st
import numpy as np
from strategies import matched_points, Pose, poses_behind_the_goal

from visual_servo_epipolar.core.geometry.least_squares import (
    Damped,
    Equations,
    least_squares,
    linear_fit,
    null_vector,
    robust_fit,
    samples,
)
from visual_servo_epipolar.core.geometry.significance import log_false_alarms
from visual_servo_epipolar.core.tracking.robust_geometry import epipolar_geometry


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


FOCAL, CENTRE = 192.0, np.array([160.0, 128.0])
CHANCE = -2.0


def frames(pixels: np.ndarray, rng: np.random.Generator) -> np.ndarray:
    """Return features of any direction and size at ``pixels``."""
    count = len(pixels)
    return np.column_stack([pixels, rng.uniform(0.0, 6.28, count), rng.uniform(1.0, 3.0, count)])


def turned(features: np.ndarray, pixels: np.ndarray, rng: np.random.Generator) -> np.ndarray:
    """Return the features at other ``pixels``, but for noise of the same direction and size."""
    change = rng.normal(0.0, (0.1, 0.1), (len(pixels), 2))
    return np.column_stack([pixels, features[:, 2:] + change])


def exponent(current: np.ndarray, desired: np.ndarray) -> float:
    geometry, inliers = epipolar_geometry(current[:, :2], desired[:, :2])
    if geometry is None:
        return math.inf
    return log_false_alarms(geometry, current, desired, inliers)


@settings(max_examples=60, deadline=None)
@given(seed=st.integers(0, 2**31 - 1), count=st.integers(8, 120))
def test_random_matches_are_explained_by_chance(seed: int, count: int) -> None:
    rng = np.random.default_rng(seed)
    current, desired = rng.uniform((0.0, 0.0), (320.0, 256.0), (2, count, 2))
    assert exponent(frames(current, rng), frames(desired, rng)) > CHANCE


@settings(max_examples=40, deadline=None)
@given(pose=poses_behind_the_goal(), seed=st.integers(0, 2**31 - 1))
def test_true_matches_are_not_explained_by_chance(pose, seed: int) -> None:
    rng = np.random.default_rng(seed)
    current, desired = (FOCAL * points + CENTRE for points in matched_points(pose, count=30))
    desired = frames(desired + rng.normal(0.0, 0.3, desired.shape), rng)
    current = turned(desired, current + rng.normal(0.0, 0.3, current.shape), rng)
    current[:10, :2] = rng.uniform((0.0, 0.0), (320.0, 256.0), (10, 2))  # a third is wrong
    assert exponent(current, desired) < CHANCE


def test_directions_that_agree_weigh_as_much_as_positions() -> None:
    rng = np.random.default_rng(5)
    pose = Pose.from_start(0.5, -3.0, 5.0)
    current, desired = (FOCAL * points + CENTRE for points in matched_points(pose, count=9))
    desired = frames(desired, rng)
    alike = turned(desired, current, rng)
    unlike = np.column_stack([current, frames(current, rng)[:, 2:]])
    assert exponent(alike, desired) < CHANCE < exponent(unlike, desired)


def test_fewer_than_eight_prove_nothing() -> None:
    rng = np.random.default_rng(0)
    current = frames(rng.uniform(0.0, 300.0, (7, 2)), rng)
    assert log_false_alarms(np.eye(3), current, current, np.ones(7, bool)) == math.inf
