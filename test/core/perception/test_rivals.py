"""Rivals: two geometries of a plane, of which a straight way leaves the true one."""

from dataclasses import replace
import math

import numpy as np
import pytest
from servo_states import in_phase, MEMORY, sight

from visual_servo_epipolar.core.geometry.epipolar import Bearings
from visual_servo_epipolar.core.geometry.motion import Pose, Twist
from visual_servo_epipolar.core.geometry.rays import normalised
from visual_servo_epipolar.core.geometry.wall import exchanged_bearings
from visual_servo_epipolar.core.laws.command import Command
from visual_servo_epipolar.core.laws.phase import Phase
from visual_servo_epipolar.core.perception.observation import Observation
from visual_servo_epipolar.core.perception.rivals import (
    ahead_of_both,
    begun,
    followed,
    in_order,
    Rivals,
    turned,
)
from visual_servo_epipolar.core.servo.fuse import _with_rivals

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


def after(rivals: Rivals, start: Pose, way: float, rng: np.random.Generator) -> Rivals:
    """Return what a straight way [m] shows, in 30 views."""
    step = way / 30
    for k in range(30):
        along = k * step
        pose = Pose(
            start.x + along * math.cos(start.theta),
            start.y + along * math.sin(start.theta),
            start.theta,
        )
        observation, both = view(pose, rng)
        rivals = followed(rivals, in_order(both, rivals), observation, step)
    return rivals


@pytest.mark.parametrize('backward', [False, True])
@pytest.mark.parametrize('seed', range(6))
def test_a_straight_way_leaves_the_true_geometry(seed: int, backward: bool) -> None:
    rng = np.random.default_rng(seed)
    start = Pose(rng.choice([-1.0, 1.0]) * rng.uniform(0.5, 1.2), -2.0, 0.5 * math.pi)
    _, both = view(start, rng)
    rivals = after(begun(both, 0.0), start, -0.3 if backward else 0.3, rng)
    decided = rivals.decided(0.0)
    assert decided is not None
    assert both[decided] == Bearings.from_pose(start)
    assert rivals.way == pytest.approx(0.3)


def test_a_robot_that_stands_shows_nothing() -> None:
    rng, start = np.random.default_rng(1), Pose(0.8, -2.0, 0.5 * math.pi)
    rivals = after(begun(view(start, rng)[1], 0.0), start, 0.0, rng)
    assert rivals.decided(0.0) is None


def test_the_camera_is_driven_where_its_yaw_has_it() -> None:
    rng, start = np.random.default_rng(2), Pose(0.8, -2.0, 0.5 * math.pi)
    rivals = after(begun(view(start, rng)[1], 0.0), start, 0.3, rng)
    first, second = rivals.misfits(0.0), rivals.misfits(math.radians(5.0))
    assert first.min() < 2.0 < 10.0 < second.min()


def test_legs_add_up() -> None:
    rng, start = np.random.default_rng(3), Pose(0.3, -2.0, 0.5 * math.pi)
    _, both = view(start, rng)
    leg = after(begun(both, 0.0), start, 0.2, rng)
    over = turned(leg, in_order(both, leg), 0.0)
    assert over.misfits(0.0) == pytest.approx(leg.misfits(0.0))
    assert over.way == leg.way


def test_the_scene_lies_ahead_by_one_sign() -> None:
    rng, start = np.random.default_rng(4), Pose(0.8, -2.0, 0.5 * math.pi)
    observation, _ = view(start, rng)
    true = Bearings.from_pose(start)
    for each in (true, true.reversed()):
        assert ahead_of_both(each, observation).psi == pytest.approx(true.psi)


@pytest.mark.parametrize(('turn', 'straight'), [(0.004, True), (0.1, False)])
def test_a_turn_that_undoes_a_curvature_leads_straight_on(turn: float, straight: bool) -> None:
    """A robot whose way was not counted would back off for ever."""
    rng, start = np.random.default_rng(5), Pose(0.8, -2.0, 0.5 * math.pi)
    observation, both = view(start, rng)
    seen = replace(sight(bearings=None), rivals=both)
    state = in_phase(Phase.RETREATING, command=Command(Twist(-0.2, turn)))
    memory = replace(MEMORY, rivals=begun(both, 0.0))
    after = _with_rivals(memory, seen, observation, state, -0.02).rivals
    assert after is not None
    assert after.way == (0.02 if straight else 0.0)
