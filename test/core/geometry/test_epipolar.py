"""Epipolar geometry of the planar motion: sections II and IV-A, and the sign the paper misses."""

import math

from hypothesis import example, given
from hypothesis import strategies as st
import numpy as np
import pytest
from strategies import (
    angles,
    assert_same_matrix,
    blurred,
    CAMERA,
    floats,
    fundamental_from_pose,
    matches,
    panorama,
    poses,
    poses_behind_the_goal,
    random_rays,
    regular_poses,
    seen_from,
)

from visual_servo_epipolar.core.errors import DegenerateGeometryError
from visual_servo_epipolar.core.geometry.cheirality import cheirality, oriented_bearings
from visual_servo_epipolar.core.geometry.epipolar import (
    Bearings,
    cross_matrix,
    epipoles,
    fundamental_from_bearings,
    rotation_desired_current,
    sampson_distance,
)
from visual_servo_epipolar.core.geometry.motion import HALF_PI, Pose, wrap_angle
from visual_servo_epipolar.core.geometry.rays import normalised, tangents

K = CAMERA.matrix
NOISE = 0.3 / 769.0  # of a ray coordinate, at the tracking error of a plain tracker
BEHIND, AHEAD = Pose(1.0, -3.0, HALF_PI), Pose(1.0, 2.0, HALF_PI)
BESIDE = Pose(2.0, 0.0, HALF_PI)  # both epipoles at infinity


def assert_same_point(one: np.ndarray, other: np.ndarray) -> None:
    """Compare homogeneous points: parallel up to rounding by a condition number of 1e6."""
    np.testing.assert_allclose(
        np.cross(one / np.linalg.norm(one), other / np.linalg.norm(other)), 0.0, atol=1e-9
    )


def assert_same_angle(one: float, other: float, tolerance: float) -> None:
    assert abs(wrap_angle(one - other)) <= tolerance


@given(poses(), floats(1e-6, 1e6), st.sampled_from([1.0, -1.0]))
@example(BESIDE, 1.0, 1.0)
def test_epipoles_are_the_images_of_the_camera_centres(pose, scale, sign) -> None:
    current, desired = epipoles(sign * scale * fundamental_from_pose(K, pose))
    goal_seen_from_current = seen_from(pose, np.zeros((1, 3)))[0]
    assert_same_point(current, K @ goal_seen_from_current)
    assert_same_point(desired, K @ [pose.x, 0.0, pose.y])


@given(poses())
def test_f_is_the_product_that_section_ii_prints(pose: Pose) -> None:
    rotation = rotation_desired_current(pose.heading_error)
    inverse = np.linalg.inv(K)
    printed = inverse.T @ cross_matrix(np.array([pose.x, 0.0, pose.y])) @ rotation @ inverse
    assert_same_matrix(fundamental_from_pose(K, pose), printed, 1e-12)
    promised = fundamental_from_bearings(Bearings.from_pose(pose))
    assert np.linalg.norm(promised) == pytest.approx(math.sqrt(2.0))


@given(poses())
@example(BESIDE)
def test_bearings_point_to_the_camera_centres(pose: Pose) -> None:
    found = Bearings.from_pose(pose)
    goal = seen_from(pose, np.zeros((1, 3)))[0]
    assert_same_angle(found.current, math.atan2(goal[0], goal[2]), 1e-12)
    assert_same_angle(found.desired, math.atan2(pose.x, pose.y), 1e-12)
    assert_same_angle(found.heading_error, pose.heading_error, 1e-12)


@given(regular_poses())
def test_sigma_is_negative_while_the_goal_lies_ahead_and_the_other_one_reversed(pose) -> None:
    found = Bearings.from_pose(pose)
    assert found.sigma == math.copysign(1.0, math.cos(found.psi - pose.theta))
    assert (found.sigma < 0.0) == (seen_from(pose, np.zeros((1, 3)))[0, 2] > 0.0)
    other = found.reversed()
    assert other.epipole_current == pytest.approx(found.epipole_current, abs=1e-11)
    assert other.epipole_desired == pytest.approx(found.epipole_desired, abs=1e-11)
    assert other.sigma == -found.sigma


@given(poses_behind_the_goal(), floats(1e-6, 1e-4), angles(), angles(), angles())
def test_the_sampson_distance_is_across_the_constraint(pose, size, share, first, second) -> None:
    current, desired = (rays[:8] for rays in matches(pose))
    fundamental = fundamental_from_bearings(Bearings.from_pose(pose))
    slopes, turned = [], []
    for rays, normal, turn, part in (
        (current, desired @ fundamental, first, math.cos(share)),
        (desired, current @ fundamental.T, second, math.sin(share)),
    ):
        right, down = np.array(tangents(*rays.T)).swapaxes(1, 2)
        move = part * (math.cos(turn) * right + math.sin(turn) * down)
        slopes.append(
            np.array([(normal * right).sum(1), (normal * down).sum(1), (normal * move).sum(1)])
        )
        turned.append(normalised(rays + size * move))
    along = size * (slopes[0][2] + slopes[1][2])
    gradient = np.sqrt((slopes[0][:2] ** 2).sum(axis=0) + (slopes[1][:2] ** 2).sum(axis=0))
    distance = sampson_distance(fundamental, *turned)
    # First order: what is left is the turn squared over the angle to the epipole.
    np.testing.assert_allclose(distance, along / gradient, atol=50.0 * size**2)


@given(poses(min_baseline=0.3), floats(0.2, 5.0), floats(0.2, 5.0))
def test_the_noise_of_each_ray_weighs_its_gradient(pose, current_noise, desired_noise) -> None:
    current, desired = matches(pose)
    desired = desired[::-1]
    fundamental = fundamental_from_bearings(Bearings.from_pose(pose))
    noise = np.tile([current_noise, desired_noise], (len(current), 1))
    weighted = sampson_distance(fundamental, current, desired, noise)
    plain = sampson_distance(fundamental, current, desired)
    low, high = sorted([current_noise, desired_noise])
    assert (np.abs(weighted) <= np.abs(plain) / low * (1.0 + 1e-12)).all()
    assert (np.abs(weighted) >= np.abs(plain) / high * (1.0 - 1e-12)).all()


@given(poses(min_baseline=0.3))
def test_rays_behind_the_camera_obey_f_and_vote_right(pose: Pose) -> None:
    current, desired = panorama(pose)
    true = Bearings.from_pose(pose)
    assert (current[:, 2] < 0.0).any()
    distance = sampson_distance(fundamental_from_bearings(true), current, desired)
    np.testing.assert_allclose(distance, 0.0, atol=1e-12)
    for candidate in (true, true.reversed()):
        vote = cheirality(candidate, current, desired, noise=NOISE)
        assert_same_angle(vote.bearings.psi, true.psi, 1e-9)
        assert vote.confidence > 0.9


@given(poses(min_baseline=0.3))
@example(BEHIND)
@example(AHEAD)
@example(BESIDE)
def test_matches_orient_the_baseline_at_every_pose(pose: Pose) -> None:
    true = Bearings.from_pose(pose)
    fundamental = -fundamental_from_bearings(true)
    found = oriented_bearings(fundamental, *matches(pose), noise=NOISE).bearings
    # F is exact, hence only the signs are in question.
    assert_same_angle(found.psi, true.psi, 1e-9)
    assert_same_angle(found.phi, true.phi, 1e-9)


@given(poses_behind_the_goal(), st.booleans())
def test_the_vote_survives_outliers_of_three_in_ten(pose: Pose, flip: bool) -> None:
    current, desired = matches(pose)
    current = current.copy()
    current[::3] = random_rays(np.random.default_rng(5), 14)
    true = Bearings.from_pose(pose)
    vote = cheirality(true.reversed() if flip else true, current, desired, noise=NOISE)
    assert_same_angle(vote.bearings.psi, true.psi, 1e-9)


@given(angles(), floats(-0.4, 0.4))
def test_a_pure_rotation_decides_nothing(psi: float, alpha: float) -> None:
    turned = Pose(0.0, 0.0, HALF_PI + alpha)
    current, desired = matches(turned)
    rng = np.random.default_rng(11)
    noisy = blurred(current, NOISE, rng)
    vote = cheirality(Bearings(psi, wrap_angle(psi - turned.theta)), noisy, desired, noise=NOISE)
    # Forty random votes of weight 1/9: three deviations are 3 / sqrt(40) / 9 = 0.05.
    assert vote.confidence < 0.1
    assert cheirality(vote.bearings, current, desired, noise=NOISE).confidence < 1e-12


@pytest.mark.parametrize(
    ('call', 'words'),
    [
        (lambda: Bearings.from_pose(Pose(0.0, 0.0, 1.0)), 'need a baseline'),
        (lambda: epipoles(np.zeros((3, 3))), 'must have rank 2, got singular values'),
        (lambda: epipoles(np.diag([1.0, 0.0, 0.0])), 'must have rank 2, got singular values'),
        (
            lambda: oriented_bearings(
                cross_matrix(np.array([0.0, 1.0, 0.0])), *matches(BEHIND), noise=NOISE
            ),
            'must lie in the plane of motion',
        ),
    ],
)
def test_what_has_no_epipoles_in_the_plane_of_motion_is_refused(call, words) -> None:
    with pytest.raises(DegenerateGeometryError, match=words):
        call()
