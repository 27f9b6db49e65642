"""Significance: chance is told from geometry."""

import math

from hypothesis import given, settings
from hypothesis import strategies as st
import numpy as np
from strategies import matched_points, Pose, poses_behind_the_goal

from visual_servo_epipolar.core.geometry.significance import log_false_alarms
from visual_servo_epipolar.core.tracking.robust_geometry import epipolar_geometry

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
