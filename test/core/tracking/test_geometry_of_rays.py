"""One geometry of rays all around, many of them wrong, in level cameras and tilted ones."""

import math

from hypothesis import given
from hypothesis import strategies as st
import numpy as np
import pytest

from visual_servo_epipolar.core.geometry.significance import log_false_alarms
from visual_servo_epipolar.core.tracking.robust_geometry import (
    agree_on_one_geometry,
    epipolar_geometry,
)

PIXEL = 2.0 * math.pi / 1920.0


def matches(seed: int, count: int, wrong: int, tilt: float = 0.0) -> tuple[np.ndarray, ...]:
    """Return the rays of two views, of half a pixel or so, the first ``wrong`` ones mistaken."""
    rng = np.random.default_rng(seed)
    directions = rng.standard_normal((count, 3)) * [1.0, 0.5, 1.0]
    points = (
        directions
        * rng.uniform(2.0, 8.0, (count, 1))
        / np.linalg.norm(directions, axis=1, keepdims=True)
    )
    turn, (x, z) = rng.uniform(-math.pi, math.pi), rng.uniform(-1.5, 1.5, 2)
    c, s, up, down = math.cos(turn), math.sin(turn), math.cos(tilt), math.sin(tilt)
    lean = np.array([[1.0, 0.0, 0.0], [0.0, up, -down], [0.0, down, up]])
    rotation = lean @ np.array([[c, 0.0, s], [0.0, 1.0, 0.0], [-s, 0.0, c]])
    views = points @ lean.T, (points - [x, 0.0, z]) @ rotation.T
    desired, current = (
        view + 0.5 * PIXEL * 4.0 * rng.standard_normal(view.shape) for view in views
    )
    current[:wrong] = rng.standard_normal((wrong, 3)) * [1.0, 0.5, 1.0]
    return tuple(view / np.linalg.norm(view, axis=1, keepdims=True) for view in (current, desired))


@pytest.mark.parametrize(('wrong', 'tilt'), [(0, 0.0), (30, 0.0), (120, 0.0), (40, 0.3)])
def test_right_matches_are_told_from_wrong_ones(wrong: int, tilt: float) -> None:
    for seed in range(3):
        geometry, inliers = epipolar_geometry(*matches(seed, 200, wrong, tilt), PIXEL)
        assert geometry is not None
        assert inliers[wrong:].mean() > 0.9
        assert inliers[:wrong].mean() < 0.1 if wrong else True


def test_all_that_agree_are_known_at_once() -> None:
    assert agree_on_one_geometry(*matches(1, 60, 0), 4.0 * PIXEL)
    assert not agree_on_one_geometry(*matches(1, 60, 5), 4.0 * PIXEL)


def test_where_nothing_has_moved_all_fit() -> None:
    _, desired = matches(2, 40, 0)
    geometry, inliers = epipolar_geometry(desired, desired, PIXEL)
    assert geometry is not None
    assert inliers.all()


@given(st.integers(0, 30))
def test_few_or_bad_rays_are_no_error(count: int) -> None:
    rays = np.full((count, 3), math.nan)
    assert epipolar_geometry(rays, rays, PIXEL)[0] is None
    assert not agree_on_one_geometry(rays, rays, PIXEL)


def test_chance_is_told_from_a_place_that_is_seen_again() -> None:
    rng = np.random.default_rng(0)
    for wrong, low, high in ((20, -math.inf, -30.0), (60, -2.0, math.inf)):
        current, desired = matches(3, 60, wrong)
        geometry, inliers = epipolar_geometry(current, desired, PIXEL)
        if geometry is None:
            continue
        turn = rng.uniform(-3.0, 3.0, (60, 2)) * (wrong == 60)
        frames = [np.column_stack([rays, turn]) for rays in (current, desired)]
        frames[0][:, 3] += rng.uniform(-3.0, 3.0, 60) * (wrong == 60)
        assert low <= log_false_alarms(geometry, *frames, inliers) <= high


def test_eight_matches_are_enough() -> None:
    geometry, inliers = epipolar_geometry(*matches(4, 8, 0), 4.0 * PIXEL)
    assert geometry is not None
    assert inliers.all()
