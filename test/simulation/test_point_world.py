"""The cloud of points: what a perfect tracker would see of it."""

import math

from hypothesis import given, settings
import numpy as np
import pytest
from strategies import CAMERA, poses_behind_the_goal

from visual_servo_epipolar.core.epipolar import fundamental_from_pose, sampson_distance
from visual_servo_epipolar.core.motion import DESIRED_POSE, HALF_PI, Pose
from visual_servo_epipolar.simulation.point_world import PointSettings, PointWorld

EXACT = PointSettings(noise=0.0)
BEHIND = Pose(1.0, -3.0, HALF_PI)


def world(points: PointSettings = EXACT, *, seed: int = 0) -> PointWorld:
    return PointWorld(points, CAMERA, seed=seed)


def test_from_the_goal_everything_is_where_the_photograph_has_it() -> None:
    seen = world().observe(DESIRED_POSE, 0)
    assert len(seen) == EXACT.max_features
    np.testing.assert_allclose(seen.current, seen.desired, atol=1e-9)


@settings(max_examples=30)
@given(poses_behind_the_goal())
def test_exact_matches_obey_the_epipolar_constraint_of_the_pose(pose: Pose) -> None:
    seen = world().observe(pose, 0)
    fundamental = fundamental_from_pose(CAMERA.matrix, pose)
    # Pixels of 1e3 in double precision.
    np.testing.assert_allclose(
        sampson_distance(fundamental, seen.current, seen.desired), 0.0, atol=1e-9
    )


@settings(max_examples=30)
@given(poses_behind_the_goal())
def test_only_what_is_in_view_is_seen(pose: Pose) -> None:
    seen = world().observe(pose, 0)
    assert CAMERA.contains(seen.current).all()
    assert len(set(seen.ids.tolist())) == len(seen)


def test_nothing_is_seen_behind_the_camera() -> None:
    assert len(world().observe(Pose(0.0, 0.0, -HALF_PI), 0)) == 0


def test_a_robot_that_turns_left_sees_the_points_move_right() -> None:
    seen = world().observe(Pose(0.0, 0.0, HALF_PI + 0.05), 0)
    assert (seen.current[:, 0] > seen.desired[:, 0]).all()


def test_a_robot_that_backs_off_sees_the_points_draw_together() -> None:
    seen = world().observe(Pose(0.0, -1.0, HALF_PI), 0)
    centre = [CAMERA.cx, CAMERA.cy]
    current = np.linalg.norm(seen.current - centre, axis=1)
    assert (current < np.linalg.norm(seen.desired - centre, axis=1)).all()


def test_an_id_keeps_its_point() -> None:
    near, far = world().observe(BEHIND, 0), world().observe(Pose(0.5, -1.0, HALF_PI), 7)
    _, in_near, in_far = np.intersect1d(near.ids, far.ids, return_indices=True)
    assert len(in_near) > 8
    np.testing.assert_array_equal(near.desired[in_near], far.desired[in_far])


@pytest.mark.parametrize('noise', [0.2, 1.0])
def test_noise_has_the_deviation_asked_for(noise: float) -> None:
    settings = PointSettings(noise=noise, candidates=4000, max_features=4000)
    exact, visible = world(settings).project(BEHIND)
    seen = world(settings).observe(BEHIND, 3)
    error = seen.current - exact[seen.ids]
    assert visible[seen.ids].all()
    # Some thousand coordinates: the deviation is known to 1 %, the mean to 0.02 of it.
    assert error.std() == pytest.approx(noise, rel=0.05)
    assert abs(error.mean()) < 0.08 * noise


def test_the_noise_of_the_photograph_does_not_change() -> None:
    noisy = world(PointSettings(noise=1.0))
    one, other = noisy.observe(BEHIND, 0), noisy.observe(BEHIND, 1)
    np.testing.assert_array_equal(one.desired, other.desired)
    assert (one.current != other.current).all()


def test_the_same_seed_and_frame_see_the_same() -> None:
    points = PointSettings(noise=1.0)
    one = world(points, seed=4).observe(BEHIND, 2)
    same = world(points, seed=4).observe(BEHIND, 2)
    other = world(points, seed=5).observe(BEHIND, 2)
    np.testing.assert_array_equal(one.current, same.current)
    assert not np.array_equal(one.current, other.current)


def test_points_lie_between_near_and_far() -> None:
    # Seen from the axis at 1 m behind the goal, a point at depth z shrinks by z / (z + 1).
    seen = world().observe(Pose(0.0, -1.0, HALF_PI), 0)
    centre = [CAMERA.cx, CAMERA.cy]
    ratio = np.linalg.norm(seen.current - centre, axis=1) / np.linalg.norm(
        seen.desired - centre, axis=1
    )
    depth = ratio / (1.0 - ratio)
    assert EXACT.near - 1e-6 <= depth.min()
    assert depth.max() <= EXACT.far + 1e-6
    assert math.isclose(depth.mean(), 5.5, rel_tol=0.15)  # uniform from 3 to 8 m
