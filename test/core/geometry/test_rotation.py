"""Rotation between the views where there is no baseline (the remark closing section IV-B)."""

from hypothesis import given
from hypothesis import strategies as st
import numpy as np
import pytest
from strategies import floats, matches, panorama, random_rays

from visual_servo_epipolar.core.errors import DegenerateGeometryError
from visual_servo_epipolar.core.geometry.epipolar import MIN_MATCHES, rotation_desired_current
from visual_servo_epipolar.core.geometry.motion import HALF_PI, Pose
from visual_servo_epipolar.core.geometry.rays import normalised, rotation_level_camera
from visual_servo_epipolar.core.geometry.rotation import fit_rotation, rotated, rotation_vector
from visual_servo_epipolar.core.geometry.wall import aside


def turned(alpha: float) -> Pose:
    return Pose(0.0, 0.0, HALF_PI + alpha)


@pytest.mark.parametrize(('scene', 'part'), [(matches, 0.25), (panorama, 1.0)])
@given(turn=floats(-3.0, 3.0))
def test_a_pure_rotation_is_found_exactly_left_positive(scene, part, turn: float) -> None:
    alpha = part * turn  # far from the axis no pinhole sees the same features
    fit = fit_rotation(*scene(turned(alpha)))
    assert fit.heading_error == pytest.approx(alpha, abs=1e-12)
    np.testing.assert_allclose(fit.rotation, rotation_desired_current(alpha), atol=1e-12)
    assert fit.parallax < 1e-12


@given(floats(-0.8, 0.8))
def test_two_outliers_in_ten_do_not_turn_the_fit(alpha: float) -> None:
    current, desired = matches(turned(alpha))
    current = current.copy()
    current[::5] = random_rays(np.random.default_rng(9), 8)
    fit = fit_rotation(current, desired)
    # Each of six rounds cuts their pull by ten or more; a hundredth of a pixel is left at most.
    assert fit.heading_error == pytest.approx(alpha, abs=1e-5)
    assert fit.parallax < 1e-5


def test_tilt_and_roll_are_found_as_well() -> None:
    rotation = rotation_desired_current(0.2) @ rotation_level_camera(-0.03, -0.02)
    _, desired = matches(turned(0.0))
    fit = fit_rotation(desired @ rotation, desired)  # R^T p_d
    np.testing.assert_allclose(fit.rotation, rotation, atol=1e-12)


def test_two_matches_are_too_few() -> None:
    with pytest.raises(DegenerateGeometryError, match='at least 3 matches, got 2; track more'):
        fit_rotation(np.zeros((2, 3)), np.zeros((2, 3)))


@given(st.tuples(*[floats(-1.7, 1.7)] * 3))
def test_a_rotation_vector_rotates_as_its_matrix(vector: tuple[float, float, float]) -> None:
    turn = np.array(vector)
    matrix = rotated(np.eye(3), np.tile(turn, (3, 1))).T  # its columns are the axes, rotated
    np.testing.assert_allclose(matrix @ matrix.T, np.eye(3), atol=1e-12)
    np.testing.assert_allclose(matrix @ turn, turn, atol=1e-12)
    np.testing.assert_allclose(rotation_vector(matrix), turn, atol=1e-9)


NOISE = 0.2 / 769.0  # of a coordinate [rad]
WRONG = 12  # of 60 features


def views_of_wall(
    offset: float, seed: int, *, relief: float = 0.0, turn: float = 0.0, count: int = 60
) -> tuple[np.ndarray, np.ndarray]:
    """Return what is seen ``offset`` [m] aside of the photograph of a wall at 5 m, and that."""
    rng = np.random.default_rng(seed)
    depths = 5.0 * (1.0 + relief * rng.uniform(-1.0, 1.0, count))
    points = np.column_stack([rng.uniform(-0.8, 0.8, (count, 2)), np.ones(count)])
    points *= depths[:, None]
    current = (points - [offset, 0.0, 0.0]) @ rotation_desired_current(turn)
    both = [
        normalised(of / of[:, 2:] + [1.0, 1.0, 0.0] * rng.normal(0.0, NOISE, (count, 3)))
        for of in (current, points)
    ]
    return both[0], both[1]


@pytest.mark.parametrize('relief', [0.0, 0.04, 0.4])
@pytest.mark.parametrize('side', [-1.0, 1.0])
def test_a_centimetre_aside_is_seen_and_on_which_side(relief: float, side: float) -> None:
    found = [aside(*views_of_wall(0.01 * side, seed, relief=relief)) for seed in range(20)]
    assert side * np.median(found) > 4.0
    assert min(side * value for value in found) > 2.0


def test_at_the_goal_it_is_noise() -> None:
    found = [aside(*views_of_wall(0.0, seed, turn=0.02)) for seed in range(200)]
    assert abs(np.mean(found)) < 0.3
    assert np.std(found) == pytest.approx(1.0, abs=0.25)


def test_wrong_matches_do_not_hide_it() -> None:
    found = []
    for seed in range(20):
        current, desired = views_of_wall(0.01, seed)
        current[:WRONG] = np.roll(current[:WRONG], 1, axis=0)
        found.append(aside(current, desired))
    assert min(found) > 2.0


def test_too_few_or_all_in_one_place_tell_nothing() -> None:
    current, desired = views_of_wall(0.01, 3)
    few = MIN_MATCHES - 1
    assert aside(current[:few], desired[:few]) == 0.0
    alike = np.repeat(desired[:1], 20, axis=0)
    assert aside(alike, alike) == 0.0
    behind = desired * [1.0, 1.0, -1.0]
    assert aside(behind, behind) == 0.0
