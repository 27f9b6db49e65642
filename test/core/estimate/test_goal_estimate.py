"""The estimate of the goal: its pose in the base, and how errors of camera and mount reach it."""

from dataclasses import replace
import math

import numpy as np
import pytest
from servo_states import reading, SETTINGS, sight

from visual_servo_epipolar.core.estimate.goal_estimate import BaseModel, goal_estimate, Source
from visual_servo_epipolar.core.reasons import Reason
from visual_servo_epipolar.core.rigs.fixed_mount import offset_at_axle

POSE, MOUNT = np.array([0.3, -1.2, 0.4]), np.array([0.2, 0.25, -0.1])
KNOWN = SETTINGS.extrinsics
MOUNTED = replace(KNOWN, configured=MOUNT, mean=np.concatenate([KNOWN.mean[:2], MOUNT]))
ROOT = np.diag([0.01, 0.02, 0.003])
OF_CAMERA = ROOT @ np.array([[1.0, 0.3, -0.2], [0.3, 1.0, 0.5], [-0.2, 0.5, 1.0]]) @ ROOT


def estimate(pose=POSE, mount=MOUNT, mounted=MOUNTED, **changes):
    """Return the estimate by the map, of a camera at ``pose`` on a ``mount``."""
    x, y, heading = pose
    offset = offset_at_axle((x, y), heading, mount)
    seen = replace(sight(), offset=offset, heading_error=heading, **changes)
    known = reading(pose_covariance=OF_CAMERA)
    return goal_estimate(seen, known, mounted, BaseModel())


def vector(pose=POSE, mount=MOUNT):
    """Return the goal in the base, (3,)."""
    goal = estimate(pose, mount).in_base()
    assert goal is not None
    return goal[0]


def slope(function, at):
    """Return the derivative of ``function`` at ``at``, by differences."""
    steps = 1e-6 * np.eye(len(at))
    return np.stack([(function(at + h) - function(at - h)) / 2e-6 for h in steps], axis=1)


def test_a_robot_behind_its_goal_has_it_ahead_and_one_to_the_right_has_it_to_the_left() -> None:
    ahead = vector(np.array([0.0, -2.0, 0.0]), np.zeros(3))
    assert ahead == pytest.approx([2.0, 0.0, 0.0])
    assert vector(np.array([0.5, 0.0, 0.0]), np.zeros(3)) == pytest.approx([0.0, 0.5, 0.0])
    turned = vector(np.array([0.0, -2.0, 0.5 * math.pi]), np.zeros(3))
    assert turned == pytest.approx([0.0, -2.0, -0.5 * math.pi])


def test_its_covariance_is_that_of_camera_and_mount_to_first_order() -> None:
    goal = estimate().in_base()
    assert goal is not None
    by_camera = slope(lambda pose: vector(pose), POSE)
    by_mount = slope(lambda mount: vector(POSE, mount), MOUNT)
    known = MOUNTED.covariance[2:, 2:]
    expected = by_camera @ OF_CAMERA @ by_camera.T + by_mount @ known @ by_mount.T
    np.testing.assert_allclose(goal[1], expected, rtol=1e-5, atol=1e-12)


def test_a_mount_that_is_likely_but_not_believed_adds_what_it_differs_by() -> None:
    off = np.array([0.05, -0.02, 0.03])
    likely = replace(MOUNTED, mean=MOUNTED.mean + np.concatenate([np.zeros(2), off]))
    goal, surer = estimate(mounted=likely).in_base(), estimate().in_base()
    assert goal is not None and surer is not None
    by_mount = slope(lambda mount: vector(POSE, mount), MOUNT) @ off
    np.testing.assert_allclose(goal[1] - surer[1], np.outer(by_mount, by_mount), atol=1e-8)


def test_two_views_have_bearings_and_no_pose() -> None:
    of_two = goal_estimate(sight(), None, MOUNTED, BaseModel())
    assert (of_two.source, of_two.cause) == (Source.TWO_VIEWS, Reason.NONE)
    assert of_two.in_base() is None
    assert np.isnan(of_two.pose_covariance).all()


def test_it_says_what_it_is_by_and_why_it_has_no_bearings() -> None:
    assert estimate().source is Source.MEMORY
    assert estimate(carried=True).source is Source.CARRIED
    doubt = Reason.TILTED.of(4.0)
    unseen = sight(bearings=None, reason=doubt)
    blind = goal_estimate(unseen, None, MOUNTED, BaseModel())
    assert (blind.source, blind.cause) == (Source.NOTHING, Reason.TILTED)
