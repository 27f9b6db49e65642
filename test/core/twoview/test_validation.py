"""The reasons not to act on an estimate, and what is remembered from frame to frame."""

from dataclasses import replace
import math
import re

import cv2
from hypothesis import given
import numpy as np
import pytest
from strategies import bearings, floats

from visual_servo_epipolar.core.geometry.epipolar import Bearings, cross_matrix
from visual_servo_epipolar.core.geometry.least_squares import likeliest_noise
from visual_servo_epipolar.core.geometry.rays import handedness, unit_rays
from visual_servo_epipolar.core.servo.settings import ServoSettings
from visual_servo_epipolar.core.twoview.estimator import Attitude, Estimate, UNKNOWN_COVARIANCE
from visual_servo_epipolar.core.twoview.memory import (
    fresh_memory,
    KNOWN_DEVIATION,
    PerceptionMemory,
    updated_memory,
)
from visual_servo_epipolar.core.twoview.validation import (
    fit_quality,
    FitQuality,
    innovation,
    MAX_REJECTIONS,
    rejection_reason,
    rolled_over,
    turned_otherwise,
)

SETTINGS = ServoSettings()
BEARINGS = Bearings(-1.5, 3.0)
POINTS = np.random.default_rng(0).random((30, 2)) - 0.5
RAYS, PIXEL = unit_rays(POINTS), np.full((30, 2), 1e-3)
FRESH = fresh_memory(SETTINGS)
GOOD = Estimate(
    bearings=BEARINGS,
    fundamental=cross_matrix(np.array([1.0, 0.0, 0.0])),
    inliers=np.ones(30, dtype=bool),
    confidence=0.9,
    covariance=1e-6 * np.eye(2),
    attitude=Attitude(0.02, 0.01, 1e-3, 2e-3, 0.0),
)


def quality_of(estimate: Estimate = GOOD, rays: np.ndarray = RAYS) -> FitQuality:
    return fit_quality(estimate, rays, rays, PIXEL, FRESH.noise)


def reason(memory: PerceptionMemory = FRESH, rays: np.ndarray = RAYS, **changes: object) -> str:
    estimate = replace(GOOD, **changes)  # type: ignore[arg-type]
    return rejection_reason(
        estimate, quality_of(estimate, rays), memory, SETTINGS, SETTINGS.floor_jitter
    )


def some(count: int) -> np.ndarray:
    return np.arange(30) < count


def test_a_good_estimate_is_trusted() -> None:
    assert reason() == ''


@pytest.mark.parametrize(
    ('changes', 'said'),
    [
        ({'inliers': some(7)}, 'only 7 of 30 matches agree'),
        ({'inliers': some(8)}, 'only 8 of 30 matches agree'),
        ({'rays': unit_rays(0.01 * POINTS)}, 'clustered within 0.2 deg'),
        ({'rays': unit_rays(POINTS * [1.0, 0.0])}, 'clustered within 0.0 deg'),
        ({'confidence': 0.01}, r'cheirality vote is undecided \(0.010\)'),
        ({'confidence': 0.39}, r'cheirality vote is undecided \(0.390\)'),
        ({'jump': 0.1}, 'the camera tilted by 5.7 deg between the views'),
        ({'covariance': 0.04 * np.eye(2)}, 'the bearings are uncertain by 11.9 deg'),
        ({'alternative': Bearings(-1.0, 2.5)}, 'two geometries fit the features'),
    ],
)
def test_every_doubt_is_named(changes: dict[str, object], said: str) -> None:
    with_it = reason(**changes)  # type: ignore[arg-type]
    assert re.search(said, with_it)


NEARLY = (0.9 * SETTINGS.max_deviation) ** 2 * np.eye(2)  # as uncertain as is trusted
JITTER = SETTINGS.floor_jitter


@pytest.mark.parametrize(
    ('passes', 'fails', 'said'),
    [
        ({'jump': 11.5 * JITTER}, {'jump': 12.5 * JITTER}, 'the camera tilted'),
        ({'inliers': some(12)}, {'inliers': some(11)}, 'only 11 of 30 matches agree'),
        # Few matches have a larger deviation than their noise makes.
        (
            {'covariance': NEARLY},
            {'covariance': NEARLY, 'inliers': some(12)},
            'the bearings are uncertain by',
        ),
    ],
)
def test_a_doubt_begins_at_its_limit(passes, fails, said) -> None:
    assert reason(**passes) == ''
    assert reason(**fails).startswith(said)


@pytest.mark.parametrize(('count', 'doubted'), [(11, False), (10, True)])
def test_of_few_matches_most_must_agree(count: int, doubted: bool) -> None:
    """Nine of twelve agreed on a geometry of mirrored images."""
    quality = quality_of()
    few = replace(GOOD, inliers=some(count)[:13])
    said = rejection_reason(
        few, replace(quality, inliers=count), FRESH, SETTINGS, SETTINGS.floor_jitter
    )
    assert said.startswith(f'only {count} of 13 matches agree') == doubted


@pytest.mark.parametrize(
    ('apart', 'doubted'),
    [(0.0, False), (1.99, False), (-2.01, True), (math.pi, True), (4.3, False)],
)
def test_bearings_that_turn_otherwise_than_the_features_are_doubted(apart, doubted) -> None:
    said = turned_otherwise(BEARINGS, BEARINGS.heading_error + apart)
    assert said.startswith('the features as a whole have turned by') is doubted


def test_an_estimator_without_covariance_is_not_doubted_for_it() -> None:
    assert reason(covariance=UNKNOWN_COVARIANCE) == ''
    blind = replace(GOOD, covariance=UNKNOWN_COVARIANCE)
    assert math.isnan(fit_quality(blind, RAYS, RAYS, PIXEL, 0.3).deviation)


def test_a_rival_is_no_doubt_where_the_last_bearings_decide() -> None:
    known = replace(FRESH, bearings=BEARINGS)
    assert reason(known, alternative=Bearings(-1.0, 2.5)) == ''


def test_a_rival_counts_again_once_the_last_bearings_are_given_up() -> None:
    """Fifteen of sixteen features, three frames in a row, had the robot retreat."""
    away = Bearings(-1.0, 3.0)
    tired = replace(FRESH, bearings=away, consecutive_rejections=MAX_REJECTIONS - 1)
    assert reason(tired) == ''
    assert 'two geometries fit' in reason(tired, alternative=Bearings(-1.0, 2.5))


@pytest.mark.parametrize('noise', [0.15, 0.3, 0.6, 1.0])
@pytest.mark.parametrize('wrong', [0.0, 0.3])
def test_noise_is_told_from_what_is_wrong(noise: float, wrong: float) -> None:
    rng, told = np.random.default_rng(3), []
    for _ in range(100):
        distances = np.abs(rng.normal(0.0, noise, 20))
        elsewhere = rng.uniform(0.0, 40.0, 20)
        told.append(
            likeliest_noise(np.where(rng.uniform(size=20) < wrong, elsewhere, distances), 0.3)
        )
    spent = math.sqrt(20 / 16)  # which the fit has taken from real distances
    assert np.median(told) == pytest.approx(spent * noise, rel=0.15)


def test_residuals_above_the_noise_enlarge_the_deviation() -> None:
    up_and_down = np.resize([1.0, -1.0], (30, 1)) * [0.0, 1.0, 0.0]
    deviations = [
        fit_quality(GOOD, RAYS, RAYS + away * 1e-3 * up_and_down, PIXEL, 0.3).deviation
        for away in (0.0, 1.2)  # px
    ]
    assert deviations[1] > 1.5 * deviations[0]


def test_residuals_that_err_together_in_a_part_of_the_image_do_not_average_out() -> None:
    alternating, aside = np.resize([1.0, -1.0], 30), np.sign(RAYS[:, 0])
    apart, together = (
        fit_quality(GOOD, RAYS, RAYS + 1e-4 * np.outer(sign, [0.0, 1.0, 0.0]), PIXEL, 0.3)
        for sign in (alternating, aside)
    )
    assert together.deviation > 1.5 * apart.deviation


def test_a_leap_is_doubted_until_it_is_seen_three_times() -> None:
    memory = replace(FRESH, bearings=Bearings(-1.0, 3.0))
    for _ in range(MAX_REJECTIONS - 1):
        said = reason(memory)
        assert 'the bearings leapt by 28.6 deg in one frame' in said
        memory = updated_memory(memory, GOOD, said, noise=0.3, parallax=50.0)
        assert memory.bearings == Bearings(-1.0, 3.0)
    assert reason(memory) == ''
    memory = updated_memory(memory, GOOD, '', noise=0.3, parallax=50.0)
    assert (memory.bearings, memory.consecutive_rejections) == (BEARINGS, 0)


@given(bearings(), floats(-1.0, 1.0), floats(-1.0, 1.0))
def test_a_leap_is_the_larger_change_and_knows_of_full_turns(before, psi, phi) -> None:
    after = Bearings(before.psi + psi + 2.0 * math.pi, before.phi + phi - 2.0 * math.pi)
    assert innovation(after, before) == pytest.approx(max(abs(psi), abs(phi)), abs=1e-12)


def test_attitude_and_noise_are_learnt_where_the_parallax_is_informative() -> None:
    memory = updated_memory(FRESH, GOOD, '', noise=0.7, parallax=50.0)
    assert memory.noise == 0.7
    assert (memory.attitude.tilt, memory.attitude.roll) == (0.02, 0.01)
    assert memory.attitude.tilt_deviation == KNOWN_DEVIATION  # however sure the estimate is
    assert memory.attitude.roll_deviation == 2e-3
    assert memory.attitude.jitter == SETTINGS.floor_jitter


@pytest.mark.parametrize(
    ('found', 'parallax'),
    [(GOOD, 3.0), (replace(GOOD, attitude=None), 50.0)],
    ids=['little parallax', 'an estimator without one'],
)
def test_an_attitude_that_views_do_not_show_is_kept(found: Estimate, parallax: float) -> None:
    memory = updated_memory(FRESH, found, '', noise=0.3, parallax=parallax)
    assert memory.attitude == FRESH.attitude


def test_a_doubted_estimate_teaches_nothing_but_a_rejection() -> None:
    memory = replace(FRESH, bearings=BEARINGS)
    after = updated_memory(memory, GOOD, 'some reason', noise=0.7, parallax=50.0)
    assert after == replace(memory, consecutive_rejections=1)


@pytest.mark.parametrize('degrees', [0.0, 60.0, -110.0, 180.0])
@pytest.mark.parametrize('tilt', [0.0, 0.5, -0.78])
def test_a_turn_on_the_floor_is_no_roll(degrees: float, tilt: float) -> None:
    nod = cv2.Rodrigues(np.array([tilt, 0.0, 0.0]))[0]
    turn = cv2.Rodrigues(np.array([0.0, math.radians(degrees), 0.0]))[0]
    assert rolled_over(nod @ turn @ nod.T, RAYS, RAYS) == ''


@pytest.mark.parametrize('degrees', [100.0, 180.0, -170.0])
def test_no_robot_rolls_over(degrees: float) -> None:
    """Mirrored images look like it, and a geometry is found in them by chance."""
    roll = cv2.Rodrigues(np.array([0.0, 0.0, math.radians(degrees)]))[0]
    said = f'the image has rolled by {abs(degrees):.0f} deg, as if it were mirrored or upside down'
    assert rolled_over(roll, RAYS, RAYS @ roll.T) == said
    assert rolled_over(roll, RAYS, RAYS * [-1.0, 1.0, 1.0]) == said


def boards(observer: np.ndarray, heading: float) -> np.ndarray:
    """Return unit rays of two boards, one behind the other, (N, 3), from a place on the floor."""
    rng = np.random.default_rng(1)
    low, high = (-0.6, -0.5, 0.0), (0.6, 0.4, 0.0)
    near = rng.uniform(low, high, (40, 3)) + [0.3, 0.1, 1.0]
    far = rng.uniform(low, high, (40, 3)) + [-0.3, 0.0, 3.0]
    turn = cv2.Rodrigues(np.array([0.0, heading, 0.0]))[0]
    rays = (np.concatenate([near, far]) - observer) @ turn
    return np.asarray(rays / np.linalg.norm(rays, axis=1, keepdims=True))


def test_boards_that_change_sides_by_parallax_are_no_mirrored_image() -> None:
    """From opposite sides of what stands between them, two views look mirrored as a whole."""
    rotation = np.diag([-1.0, -1.0, 1.0])
    current, desired = boards(np.array([2.0, 0.0, -0.5]), -0.7), boards(np.zeros(3), 0.0)
    assert handedness(current, desired) > 0.99
    assert rolled_over(rotation, current, desired) == ''
    assert 'mirrored' in rolled_over(rotation, current * [-1.0, 1.0, 1.0], desired)
    assert 'upside down' in rolled_over(rotation, current * [-1.0, -1.0, 1.0], desired)


@pytest.mark.parametrize('count', [3, 1, 0])
def test_without_triangles_nothing_speaks_against_a_mirrored_image(count: int) -> None:
    assert handedness(np.eye(3)[:count], np.eye(3)[:count]) == 0.0
