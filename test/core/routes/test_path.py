"""The taught path: smoothed without being bent, and where one is beside it."""

import math

import numpy as np
import pytest

from visual_servo_epipolar.core.routes.path import smooth_path, TaughtPath

RADIUS, NOISE = 1.15, np.array([1e-3, 1e-3, 2e-4])


def arc_poses(way: np.ndarray) -> np.ndarray:
    turn = way / RADIUS
    return np.stack([RADIUS * np.sin(turn), RADIUS * (1.0 - np.cos(turn)), turn], axis=1)


@pytest.fixture
def path() -> TaughtPath:
    way = np.arange(0.0, 1.5, 0.045)
    noise = NOISE * np.random.default_rng(1).standard_normal((len(way), 3))
    return smooth_path(way, arc_poses(way) + noise, np.full(len(way), 0.5))


def test_smoothing_takes_noise_and_keeps_the_curve(path: TaughtPath) -> None:
    off = path.poses - arc_poses(path.way)
    assert np.abs(off[3:-3]).max() < 1e-3
    assert path.curvatures[5:-5] == pytest.approx(1.0 / RADIUS, abs=0.02)


def test_a_view_that_was_placed_wrongly_does_not_bend_the_path() -> None:
    way = np.arange(0.0, 1.5, 0.045)
    poses = arc_poses(way)
    poses[15] += [0.0, 0.2, 0.05]
    path = smooth_path(way, poses, np.full(len(way), 0.5))
    assert np.abs(path.poses - arc_poses(way))[10:20].max() < 1e-3


@pytest.mark.parametrize('way', [0.3, 0.62, 1.1])
@pytest.mark.parametrize('offset', [-0.05, 0.0, 0.08])
def test_offset_and_turn_are_those_beside_the_arc(
    path: TaughtPath, way: float, offset: float
) -> None:
    turn = way / RADIUS
    reach = RADIUS - offset
    pose = np.array([reach * math.sin(turn), RADIUS - reach * math.cos(turn), turn + 0.1])
    point = path.beside(pose, way + 0.1)
    assert point.way == pytest.approx(way, abs=5e-3)
    assert point.offset == pytest.approx(offset, abs=1e-3)
    assert point.turn == pytest.approx(0.1, abs=5e-3)


def test_a_path_needs_samples_that_follow_each_other() -> None:
    with pytest.raises(ValueError, match='two samples or more'):
        TaughtPath(np.zeros(1), np.zeros((1, 3)), np.zeros(1), np.zeros(1))
