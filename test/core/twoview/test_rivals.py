"""Rivals: two geometries of a plane, of which the way driven leaves the true one."""

from dataclasses import replace
import math

import numpy as np
import pytest
from servo_states import in_phase, MEMORY, SETTINGS, sight

from visual_servo_epipolar.core.geometry.epipolar import Bearings
from visual_servo_epipolar.core.geometry.motion import Pose
from visual_servo_epipolar.core.geometry.rays import normalised
from visual_servo_epipolar.core.geometry.wall import exchanged_bearings
from visual_servo_epipolar.core.laws.phase import Phase
from visual_servo_epipolar.core.servo.estimator import _with_rivals
from visual_servo_epipolar.core.twoview.observation import Observation
from visual_servo_epipolar.core.twoview.rivals import (
    ahead_of_both,
    begun,
    followed,
    in_order,
    Rivals,
)

WALL = np.array([0.05, 1.0 / 0.7])  # 0.7 m ahead of the goal, turned a little
NOISE = 5e-4  # of a ray [rad]


def view(pose: Pose, rng: np.random.Generator) -> tuple[Observation, tuple[Bearings, ...]]:
    """Return what a camera sees of the wall, and both geometries that fit it, in any order."""
    desired = normalised(np.column_stack([rng.uniform(-0.6, 0.6, (60, 2)), np.ones(60)]))
    points = desired / (desired[:, [0, 2]] @ WALL)[:, None]
    theta = pose.theta - 0.5 * math.pi
    cosine, sine = math.cos(theta), math.sin(theta)
    apart = points - [pose.x, 0.0, pose.y]
    turn = np.array([[cosine, 0.0, sine], [0.0, 1.0, 0.0], [-sine, 0.0, cosine]])
    current = normalised(apart @ turn.T) + NOISE * rng.standard_normal((60, 3))
    true = Bearings.from_pose(pose)
    other = exchanged_bearings(np.array([pose.x, pose.y, theta]), WALL)
    assert other is not None
    rivals = (true, other) if rng.random() < 0.5 else (other.reversed(), true)
    return Observation(0, normalised(current), desired, 400.0), rivals


def after(
    start: Pose,
    way: float,
    rng: np.random.Generator,
    *,
    turn: float = 0.0,
    mount: tuple[float, float, float] = (0.0, 0.0, 0.0),
) -> tuple[Rivals, tuple[Bearings, ...]]:
    """Return what a ``way`` [m] and a ``turn`` [rad] show in 30 views, and what it began with."""
    _, both = view(start, rng)
    rivals, pose = begun(both, 0.0), start
    for _ in range(30):
        observation, seen = view(pose, rng)
        rivals = followed(rivals, in_order(seen, rivals), observation, way / 30, np.array(mount))
        along = pose.theta + 0.5 * turn / 30
        pose = Pose(
            pose.x + way / 30 * math.cos(along),
            pose.y + way / 30 * math.sin(along),
            pose.theta + turn / 30,
        )
    return rivals, both


@pytest.mark.parametrize(('way', 'outward'), [(0.3, 0.0), (-0.3, 0.0), (0.3, 0.4)])
@pytest.mark.parametrize('seed', range(6))
def test_the_way_driven_leaves_the_true_geometry(seed: int, way: float, outward: float) -> None:
    rng = np.random.default_rng(seed)
    side = rng.choice([-1.0, 1.0])
    start = Pose(side * rng.uniform(0.5, 1.2), -2.0, 0.5 * math.pi)
    rivals, both = after(start, way, rng, turn=-side * outward)
    assert rivals.decided is not None
    assert both[rivals.decided] == Bearings.from_pose(start)
    assert rivals.way == pytest.approx(0.3)


def test_noisy_places_far_off_tell_as_much_as_they_show() -> None:
    """Each leg far off is known to some ten degrees alone, and the geometries differ by thirty."""
    rng, start = np.random.default_rng(3), Pose(1.3, -4.4, 1.5)
    rivals, both = after(start, 0.5, rng)
    assert rivals.decided is not None
    assert both[rivals.decided] == Bearings.from_pose(start)


def test_a_robot_that_stands_shows_nothing() -> None:
    rng, start = np.random.default_rng(1), Pose(0.8, -2.0, 0.5 * math.pi)
    assert after(start, 0.0, rng)[0].decided is None


@pytest.mark.parametrize('mount', [(0.1, 0.0, 0.0), (0.0, 0.3, 0.0)])
def test_the_camera_is_driven_where_its_mount_has_it(mount: tuple[float, float, float]) -> None:
    rng, start = np.random.default_rng(2), Pose(0.8, -2.0, 0.5 * math.pi)
    other, own = (after(start, 0.3, rng, turn=-0.4, mount=it)[0] for it in (mount, (0, 0, 0)))
    assert own.misfits.min() < 0.5 < 2.0 < other.misfits.min()


def test_the_scene_lies_ahead_by_one_sign() -> None:
    rng, start = np.random.default_rng(4), Pose(0.8, -2.0, 0.5 * math.pi)
    observation, _ = view(start, rng)
    true = Bearings.from_pose(start)
    for each in (true, true.reversed()):
        assert ahead_of_both(each, observation).psi == pytest.approx(true.psi)


def test_bearings_are_decided_while_the_law_drives_by_the_false_ones() -> None:
    rng, start = np.random.default_rng(5), Pose(0.8, -2.0, 0.5 * math.pi)
    there = Pose(0.8, -1.7, 0.5 * math.pi)
    (rivals, _), (observation, both) = after(start, 0.3, rng), view(there, rng)
    true = Bearings.from_pose(there)
    seen = replace(sight(bearings=both[1 - both.index(true)]), rivals=both)
    memory = replace(MEMORY, rivals=rivals, bearings=seen.bearings)
    state = in_phase(Phase.DISPLACING)
    decided = _with_rivals(memory, seen, observation, state, 0.0, SETTINGS)
    assert (decided.decided, decided.rivals) == (True, None)
    assert decided.bearings == true
