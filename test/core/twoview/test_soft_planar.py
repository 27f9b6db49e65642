"""The estimator for a camera that is nearly upright."""

import math

from hypothesis import given
from hypothesis import strategies as st
import numpy as np
import pytest
from strategies import floats

from visual_servo_epipolar.core.geometry.epipolar import sampson_distance
from visual_servo_epipolar.core.geometry.lens import unknown_lens
from visual_servo_epipolar.core.geometry.rays import image_points, unit_rays
from visual_servo_epipolar.core.twoview.estimator import Attitude, Estimate, Prior
from visual_servo_epipolar.core.twoview.planar_motion import matrices
from visual_servo_epipolar.core.twoview.registry import estimate
from visual_servo_epipolar.core.twoview.soft_planar import soft_planar
from visual_servo_epipolar.evaluation.benchmarks.scenes import (
    Cell,
    draw_pair,
    error,
    Pair,
)

REALISTIC = Cell(baseline=3.0, tilt=1.0, roll=0.5, jitter=0.1, outliers=0.2)
KNOWN = Attitude(math.radians(1.0), math.radians(0.5), 5e-4, 5e-4, math.radians(0.1))


def solve(cell: Cell, trial: int, prior: Prior) -> tuple[Estimate, float]:
    pair = draw_pair(cell, np.random.default_rng((3, trial)))
    rng = np.random.default_rng(0)
    found = soft_planar(pair.current, pair.desired, noise=pair.noise, prior=prior, rng=rng)
    return found, error(found.bearings, pair.bearings)


def test_the_deviations_of_tilt_and_roll_are_those_of_their_errors() -> None:
    ratios = []
    for trial in range(40):
        attitude = solve(
            Cell(baseline=3.0, tilt=1.0, roll=0.5), trial, Prior(Attitude(jitter=0.0))
        )[0].attitude
        assert attitude is not None
        ratios.append((attitude.tilt - math.radians(1.0)) / attitude.tilt_deviation)
        ratios.append((attitude.roll - math.radians(0.5)) / attitude.roll_deviation)
    # 80 errors: the root mean square has a deviation of 0.08.
    assert 0.7 < math.sqrt(np.mean(np.square(ratios))) < 1.3


@pytest.mark.parametrize('prior', [Prior(), Prior(KNOWN)], ids=['cold', 'calibrated'])
def test_tilt_roll_jitter_and_outliers_do_no_harm(prior: Prior) -> None:
    errors = [solve(REALISTIC, trial, prior)[1] for trial in range(40)]
    # 500 trials: 0.12 / 0.45 deg.
    assert np.median(errors) < 0.2
    assert max(errors) < 2.0


def test_a_jump_of_the_tilt_is_found() -> None:
    jumps = []
    for trial in range(12):
        cell = Cell(baseline=3.0, jitter=0.2)
        found, away = solve(cell, trial, Prior(Attitude(0.0, 0.0, 5e-4, 5e-4, math.radians(0.1))))
        jumps.append(math.degrees(found.jump))
        assert away < 2.0
    # Tilt and roll of two views each: 0.2 deg * sqrt(2) in tilt alone.
    assert 0.1 < np.median(jumps) < 0.8


@pytest.mark.parametrize('trial', range(4))
def test_the_last_bearings_lead_to_the_same_estimate(trial: int) -> None:
    pair = draw_pair(REALISTIC, np.random.default_rng((3, trial)))
    alone, _ = solve(REALISTIC, trial, Prior(KNOWN))
    led, _ = solve(REALISTIC, trial, Prior(KNOWN, pair.bearings, 0.15))
    # Both end within a tenth of a deviation of the noise of the one minimum.
    assert abs(math.sin(alone.bearings.psi - led.bearings.psi)) < 1e-4
    assert abs(math.sin(alone.bearings.phi - led.bearings.phi)) < 1e-4


def test_last_bearings_that_are_wrong_do_no_harm() -> None:
    pair = draw_pair(REALISTIC, np.random.default_rng((3, 0)))
    wrong = type(pair.bearings)(pair.bearings.psi + 0.8, pair.bearings.phi - 0.5)
    _, away = solve(REALISTIC, 0, Prior(KNOWN, wrong, 0.15))
    assert away < 0.5


CELL = Cell(baseline=3.0, points=60, noise=0.2, tilt=0.5, roll=-0.3)
UNKNOWN = Prior(lens=unknown_lens(1.0))
LENSES = st.tuples(floats(-1.8, 1.0), floats(-0.05, 0.05), floats(-0.05, 0.05))


@given(floats(-0.5, 0.5), floats(-0.5, 0.5), floats(-0.1, 0.1), floats(-0.1, 0.1), LENSES)
def test_the_derivatives_are_those_of_the_matrix(psi, phi, tilt, roll, lens) -> None:
    at = np.array([[psi, phi, tilt, 0.3 * tilt, roll, -0.2 * roll, *lens]])
    stack = matrices(at)
    for k in range(8):
        step = 1e-6 * np.eye(9)[k]
        rise = matrices(at + step)[0, 0] - matrices(at - step)[0, 0]
        np.testing.assert_allclose(stack[0, k + 1], rise / 2e-6, atol=1e-7)
    assert not stack[0, 9].any()  # the slope is known


def test_the_matrix_is_that_of_wrong_rays() -> None:
    angles = np.array([[0.3, -0.2, 0.02, -0.01, 0.03, 0.01]])
    true = matrices(angles)[0, 0].reshape(3, 3)
    shift = 0.01 + 0.05 * -0.7
    camera = np.array([[math.exp(-0.7), 0.0, shift], [0.0, math.exp(-0.7), 0.0], [0.0, 0.0, 1.0]])
    made = matrices(np.array([[*angles[0], -0.7, 0.01, 0.05]]))[0, 0].reshape(3, 3)
    np.testing.assert_allclose(made, camera.T @ true @ camera, atol=1e-12)


def solve_of_wrong_lens(trial: int, ratio: float, shift: float) -> tuple[Estimate, Pair]:
    """Return the estimate from rays by a camera matrix with ``ratio`` and ``shift``, cold."""
    pair = draw_pair(CELL, np.random.default_rng((5, trial)))
    wrong = [
        unit_rays((image_points(rays) - [shift, 0.0]) / ratio)
        for rays in (pair.current, pair.desired)
    ]
    # Pixels are noisy alike everywhere.
    noise = CELL.ray_noise / ratio * np.stack([rays[:, 2] for rays in wrong], axis=1) ** 1.5
    found = estimate('soft_planar', *wrong, noise=noise, prior=UNKNOWN, seed=(0, 0))
    distance = sampson_distance(found.fundamental, *map(image_points, wrong))
    assert float(np.median(np.abs(distance))) < CELL.ray_noise / ratio
    return found, pair


@pytest.mark.parametrize('ratio', [0.17, 0.5, 1.0])
def test_the_focal_length_is_found_from_one_pair_as_well_as_is_said(ratio: float) -> None:
    away, said, errors = [], [], []
    for trial in range(24):
        shift = 0.02 * float(np.random.default_rng(trial).standard_normal())
        found, pair = solve_of_wrong_lens(trial, ratio, shift)
        away.append((found.lens.log_ratio - math.log(ratio)) / found.lens.ratio_deviation)
        said.append(found.lens.ratio_deviation)
        errors.append(error(found.bearings, pair.bearings))
    # 24 errors: the root mean square has a deviation of 0.15. The belief pulls to the ratio of 1
    # where the views say little.
    assert 0.5 < math.sqrt(np.mean(np.square(away))) < 1.6
    assert np.median(said) < 0.1
    # The shift of 1.1 deg stays in both bearings as far as the pair does not show it.
    assert np.median(errors) < 1.2
