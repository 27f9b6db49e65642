"""The floor plan: where a robot can stand."""

from hypothesis import given
from hypothesis import strategies as st
import numpy as np
import pytest
from strategies import CAMERA

from visual_servo_epipolar.core.geometry.motion import HALF_PI, Pose
from visual_servo_epipolar.simulation.mounts.mounting import CameraMount, FixedRig
from visual_servo_epipolar.simulation.regions import CLEARANCE, Ground, inside
from visual_servo_epipolar.simulation.rooms.scene import room

SQUARE = np.array([[[1.0, 1.0, 0.5], [3.0, 1.0, 0.5], [3.0, 2.0, 0.5], [1.0, 2.0, 0.5]]])


@pytest.fixture(scope='module')
def ground() -> Ground:
    return Ground(room(1), FixedRig(CAMERA))


@pytest.mark.parametrize(
    ('place', 'depth'),
    [
        ((2.0, 1.5), 0.5),
        ((1.2, 1.5), 0.2),
        ((1.0, 1.5), 0.0),
        ((0.0, 1.5), -1.0),
        ((2.0, 5.0), -3.0),
        ((4.0, 3.0), -np.sqrt(2.0)),
    ],
)
def test_depth_in_a_rectangle_is_the_distance_to_its_edge(place, depth) -> None:
    assert inside(np.array([place]), SQUARE)[0, 0] == pytest.approx(depth)


@given(st.floats(-5.0, 5.0), st.floats(-5.0, 5.0), st.floats(-3.2, 3.2))
def test_depth_turns_with_the_rectangle(x: float, y: float, angle: float) -> None:
    turn = np.array([[np.cos(angle), -np.sin(angle)], [np.sin(angle), np.cos(angle)]])
    turned = SQUARE.copy()
    turned[..., :2] = turned[..., :2] @ turn.T
    there = inside(np.array([[x, y]]) @ turn.T, turned)
    np.testing.assert_allclose(there, inside(np.array([[x, y]]), SQUARE), atol=1e-12)


def free(ground: Ground, x: float, y: float) -> bool:
    return ground.is_free(Pose(x, y, HALF_PI))


def test_the_goal_and_the_ways_to_it_are_free(ground: Ground) -> None:
    assert all(free(ground, x, y) for x in (-1.5, 0.0, 1.5) for y in (-5.0, -2.0, 0.0, 1.5))


def test_a_robot_stands_neither_in_furniture_nor_too_near_to_it(ground: Ground) -> None:
    # The chest: its front is 0.85 m wide, 4.4 m ahead of the goal give or take 0.1 m.
    assert not free(ground, -1.15, 4.6)
    assert not free(ground, -1.15, 4.3 - CLEARANCE + 0.15)
    assert free(ground, -1.15, 4.3 - CLEARANCE - 0.15)


def test_a_robot_can_stand_under_what_hangs(ground: Ground) -> None:
    # The banner, 3.9 m ahead, begins 2.15 m above the floor.
    assert free(ground, -0.3, 3.9)


@pytest.mark.parametrize(
    ('x', 'y'), [(-5.4, -6.0), (5.4, -12.0), (0.0, -12.9), (0.0, 7.95), (-7.0, 0.0), (0.0, 30.0)]
)
def test_walls_keep_a_robot_in(ground: Ground, x: float, y: float) -> None:
    assert not free(ground, x, y)


def test_the_camera_must_not_be_in_the_wall_either() -> None:
    wall = room(1, 'wall')
    near = Pose(0.0, 4.4, HALF_PI)
    assert Ground(wall, FixedRig(CAMERA)).is_free(near)
    assert not Ground(wall, FixedRig(CAMERA, CameraMount(forward=0.5))).is_free(near)
