"""The estimator for a camera whose focal length and principal point are not known."""

import math

from hypothesis import given
import numpy as np
import pytest
from strategies import floats

from visual_servo_epipolar.core.estimators.base import Estimate, Prior
from visual_servo_epipolar.core.estimators.machinery import wrong_lens
from visual_servo_epipolar.core.estimators.machinery.tilted_planar import matrices
from visual_servo_epipolar.core.estimators.registry import estimate
from visual_servo_epipolar.core.geometry.epipolar import image_sampson_distance
from visual_servo_epipolar.core.geometry.lens import unknown_lens
from visual_servo_epipolar.core.geometry.rays import image_points, unit_rays
from visual_servo_epipolar.evaluation.benchmarks.estimation.scenes import (
    Cell,
    draw_pair,
    error,
    Pair,
)

CELL = Cell(baseline=3.0, points=60, noise=0.2, tilt=0.5, roll=-0.3)
UNKNOWN = Prior(lens=unknown_lens(1.0))


@given(floats(-0.5, 0.5), floats(-1.8, 1.0), floats(-0.05, 0.05), floats(-0.05, 0.05))
def test_the_derivatives_are_those_of_the_matrix(
    psi: float, log_ratio: float, rest: float, shift_slope: float
) -> None:
    at = np.array([[psi, 0.3, 0.02, -0.01, 0.03, 0.01, log_ratio, rest, shift_slope]])
    stack = wrong_lens.matrices(at)
    for k in range(8):
        step = 1e-6 * np.eye(9)[k]
        rise = wrong_lens.matrices(at + step)[0, 0] - wrong_lens.matrices(at - step)[0, 0]
        np.testing.assert_allclose(stack[0, k + 1], rise / 2e-6, atol=1e-7)
    assert not stack[0, 9].any()  # the slope is known


def test_the_matrix_is_that_of_wrong_rays() -> None:
    angles = np.array([[0.3, -0.2, 0.02, -0.01, 0.03, 0.01]])
    true = matrices(angles)[0, 0].reshape(3, 3)
    shift = 0.01 + 0.05 * -0.7
    camera = np.array([[math.exp(-0.7), 0.0, shift], [0.0, math.exp(-0.7), 0.0], [0.0, 0.0, 1.0]])
    made = wrong_lens.matrices(np.array([[*angles[0], -0.7, 0.01, 0.05]]))[0, 0].reshape(3, 3)
    np.testing.assert_allclose(made, camera.T @ true @ camera, atol=1e-12)


def solve(trial: int, ratio: float, shift: float) -> tuple[Estimate, Pair]:
    """Return the estimate from rays by a camera matrix with ``ratio`` and ``shift``, cold."""
    pair = draw_pair(CELL, np.random.default_rng((5, trial)))
    wrong = [
        unit_rays((image_points(rays) - [shift, 0.0]) / ratio)
        for rays in (pair.current, pair.desired)
    ]
    # Pixels are noisy alike everywhere.
    noise = CELL.ray_noise / ratio * np.stack([rays[:, 2] for rays in wrong], axis=1) ** 1.5
    found = estimate('soft_planar', *wrong, noise=noise, prior=UNKNOWN, seed=(0, 0))
    distance = image_sampson_distance(found.fundamental, *map(image_points, wrong))
    assert float(np.median(np.abs(distance))) < CELL.ray_noise / ratio
    return found, pair


@pytest.mark.parametrize('ratio', [0.17, 0.5, 1.0])
def test_the_focal_length_is_found_from_one_pair_as_well_as_is_said(ratio: float) -> None:
    away, said, errors = [], [], []
    for trial in range(24):
        shift = 0.02 * float(np.random.default_rng(trial).standard_normal())
        found, pair = solve(trial, ratio, shift)
        away.append((found.lens.log_ratio - math.log(ratio)) / found.lens.ratio_deviation)
        said.append(found.lens.ratio_deviation)
        errors.append(error(found.bearings, pair.bearings))
    # 24 errors: the root mean square has a deviation of 0.15. The belief pulls to the ratio of 1
    # where the views say little.
    assert 0.5 < math.sqrt(np.mean(np.square(away))) < 1.6
    assert np.median(said) < 0.1
    # The shift of 1.1 deg stays in both bearings as far as the pair does not show it.
    assert np.median(errors) < 1.2
