"""Aside before a wall: seen where a turn explains nearly all, and nowhere else."""

import math

import numpy as np
import pytest

from visual_servo_epipolar.core.geometry.wall import aside, LEAST_FEATURES

NOISE = 0.2 / 769.0  # of a coordinate [rad]
WRONG = 12  # of 60 features


def rays(points: np.ndarray) -> np.ndarray:
    """Return unit rays of points, (N, 3)."""
    return points / np.linalg.norm(points, axis=1)[:, None]


def views(
    offset: float, seed: int, *, relief: float = 0.0, turn: float = 0.0, count: int = 60
) -> tuple[np.ndarray, np.ndarray]:
    """Return what is seen ``offset`` [m] aside of the photograph of a wall at 5 m, and that."""
    rng = np.random.default_rng(seed)
    depths = 5.0 * (1.0 + relief * rng.uniform(-1.0, 1.0, count))
    points = np.column_stack([rng.uniform(-0.8, 0.8, (count, 2)), np.ones(count)])
    points *= depths[:, None]
    cosine, sine = math.cos(turn), math.sin(turn)
    turned = np.array([[cosine, 0.0, sine], [0.0, 1.0, 0.0], [-sine, 0.0, cosine]])
    current = (points - [offset, 0.0, 0.0]) @ turned.T
    both = [
        rays(of / of[:, 2:] + [1.0, 1.0, 0.0] * rng.normal(0.0, NOISE, (count, 3)))
        for of in (current, points)
    ]
    return both[0], both[1]


@pytest.mark.parametrize('relief', [0.0, 0.04, 0.4])
@pytest.mark.parametrize('side', [-1.0, 1.0])
def test_a_centimetre_aside_is_seen_and_on_which_side(relief: float, side: float) -> None:
    found = [aside(*views(0.01 * side, seed, relief=relief)) for seed in range(20)]
    assert side * np.median(found) > 4.0
    assert min(side * value for value in found) > 2.0


def test_at_the_goal_it_is_noise() -> None:
    found = [aside(*views(0.0, seed, turn=0.02)) for seed in range(200)]
    assert abs(np.mean(found)) < 0.3
    assert np.std(found) == pytest.approx(1.0, abs=0.25)


def test_a_turn_is_not_aside() -> None:
    turned, straight = (aside(*views(0.01, 3, turn=turn)) for turn in (0.1, 0.0))
    assert turned == pytest.approx(straight, abs=0.3)


def test_wrong_matches_do_not_hide_it() -> None:
    found = []
    for seed in range(20):
        current, desired = views(0.01, seed)
        current[:WRONG] = np.roll(current[:WRONG], 1, axis=0)
        found.append(aside(current, desired))
    assert min(found) > 2.0


def test_too_few_or_all_in_one_place_tell_nothing() -> None:
    current, desired = views(0.01, 3)
    few = LEAST_FEATURES - 1
    assert aside(current[:few], desired[:few]) == 0.0
    alike = np.repeat(desired[:1], 20, axis=0)
    assert aside(alike, alike) == 0.0
    behind = desired * [1.0, 1.0, -1.0]
    assert aside(behind, behind) == 0.0
