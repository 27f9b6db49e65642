"""Normal equations: the Schur complement is the whole system's, robust weights are of one cost."""

from dataclasses import replace

import numpy as np
import pytest

from visual_servo_epipolar.core.mapping.adjustment import projection
from visual_servo_epipolar.core.mapping.adjustment.equations import (
    LEAST_INFORMATION,
    LEAST_OFFSET,
    OUTLIER,
    robust_cost,
    robust_weight,
    system_of,
)
from visual_servo_epipolar.core.mapping.adjustment.refinement import Geometry
from visual_servo_epipolar.core.mapping.adjustment.window import Unknowns


def moved(exact, seed=0):
    """Return the evaluation a little off the truth."""
    rng = np.random.default_rng(seed)
    at = exact.unknowns
    count = len(at.inverse_depth)
    unknowns = Unknowns(
        at.views + 1e-3 * rng.normal(size=at.views.shape),
        at.shared + 1e-3 * rng.normal(size=5),
        at.offsets + 0.5 * rng.normal(size=(2, count)),
        at.inverse_depth * (1.0 + 1e-3 * rng.normal(size=count)),
    )
    return replace(exact, unknowns=unknowns)


def whole(at):
    """Return matrix and vector of all unknowns at once, features behind the others."""
    views, count = at.window.seen.shape
    size = 5 * views + 5
    jacobian = np.zeros((views, 2, count, size + 3 * count))
    found = projection.slopes(
        at.structure, at.unknowns.views, at.window.tangent_basis, at.projection
    )
    for k in range(views):
        for n in range(count):
            jacobian[k, :, n, 5 * k : 5 * k + 5] = found[k, :5, :, n].T
            jacobian[k, :, n, size - 5 : size - 2] = found[k, 8:, :, n].T
            jacobian[k, :, n, size + 3 * n : size + 3 * n + 3] = found[k, 5:8, :, n].T
    root = np.sqrt(at.weight)[:, None, :, None]
    rows = (root * jacobian).reshape(-1, jacobian.shape[-1])
    residuals = (root[..., 0] * at.projection.residuals).ravel()
    matrix, vector = rows.T @ rows, rows.T @ residuals
    prior, slope = at.factors.equations(at.unknowns)
    matrix[:size, :size] += prior
    vector[:size] += slope
    for n in range(count):
        for axis in range(2):
            j = size + 3 * n + axis
            matrix[j, j] += at.offset_weight[n] + LEAST_OFFSET
            vector[j] += at.offset_weight[n] * at.unknowns.offsets[axis, n]
        matrix[size + 3 * n + 2, size + 3 * n + 2] += LEAST_INFORMATION
    return matrix, vector, size


def test_the_reduced_step_is_that_of_the_whole_system(exact) -> None:
    at = moved(exact)
    matrix, vector, size = whole(at)
    expected = -np.linalg.solve(matrix, vector)
    system = system_of(at)
    step = -np.linalg.solve(system.matrix, system.vector)
    scale = np.abs(expected).max()
    assert step == pytest.approx(expected[:size], abs=1e-6 * scale)
    features = system.features(step).T.ravel()
    assert features == pytest.approx(expected[size:], abs=1e-6 * scale)


def test_the_reduced_covariance_is_that_of_the_whole_system(exact) -> None:
    matrix, _, size = whole(exact)
    scale = 1.0 / np.sqrt(np.diag(matrix))
    covariance = np.linalg.inv(matrix * scale * scale[:, None]) * scale * scale[:, None]
    own = np.linalg.inv(system_of(exact).matrix)
    expected = np.diag(covariance)[:size]
    assert np.diag(own) == pytest.approx(expected, rel=1e-5)


def test_weights_are_slopes_of_the_cost() -> None:
    squares = np.array([0.1, 3.0, 8.9, 9.1, 20.0, 400.0])
    step = 1e-5
    slope = (robust_cost(squares + step) - robust_cost(squares - step)) / (2.0 * step)
    assert robust_weight(squares) == pytest.approx(slope, rel=1e-4)


def test_an_outlier_counts_no_more_than_two_bounds_and_a_true_one_wholly() -> None:
    assert robust_cost(np.array([1e12]))[0] == pytest.approx(2.0 * OUTLIER)
    assert robust_weight(np.array([0.0, OUTLIER])).tolist() == [1.0, 1.0]


def test_a_feature_that_is_not_trusted_moves_no_view(exact) -> None:
    at = moved(exact)
    far = at.unknowns.offsets.copy()
    far[:, 0] += 3.0
    trusted = at.trusted.copy()
    trusted[0] = False
    steps = []
    for offsets in (at.unknowns.offsets, far):
        unknowns = replace(at.unknowns, offsets=offsets)
        system = system_of(replace(at, unknowns=unknowns, trusted=trusted))
        steps.append(np.linalg.solve(system.matrix, system.vector))
    assert steps[0] == pytest.approx(steps[1], abs=1e-12)


def test_a_feature_that_is_not_trusted_still_follows_the_views(exact) -> None:
    trusted = exact.trusted.copy()
    trusted[0] = False
    near = exact.unknowns.inverse_depth.copy()
    near[0] *= 1.02
    at = replace(exact, trusted=trusted, unknowns=replace(exact.unknowns, inverse_depth=near))
    system = system_of(at)
    step = -np.linalg.solve(system.matrix, system.vector)
    back = near[0] + system.features(step)[2, 0]
    assert back == pytest.approx(exact.unknowns.inverse_depth[0], rel=2e-3)


def test_far_from_the_best_unknowns_outliers_are_told_less_strictly(exact) -> None:
    at = moved(exact)
    wide = replace(at, widening=100.0)
    assert (wide.weight >= at.weight).all()
    assert wide.weight.sum() > at.weight.sum()


def test_a_view_of_nothing_leaves_the_equations_regular(exact) -> None:
    seen = exact.window.seen.copy()
    seen[2] = False
    geometry = Geometry(replace(exact, window=replace(exact.window, seen=seen)))
    assert (np.diag(geometry.system.matrix) > 0.0).all()
    assert np.isfinite(geometry.root).all()
