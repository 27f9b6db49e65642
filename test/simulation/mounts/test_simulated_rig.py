"""The true geometry of two cameras on a robot: where each sees the other."""

import math

from hypothesis import given
import pytest
from strategies import floats, poses_behind_the_goal

from visual_servo_epipolar.core.cameras.pinhole import Camera
from visual_servo_epipolar.core.geometry.epipolar import Bearings
from visual_servo_epipolar.core.geometry.motion import DESIRED_POSE, Pose
from visual_servo_epipolar.simulation.mounts.mounting import CameraMount, FixedRig
from visual_servo_epipolar.simulation.mounts.simulated_rig import true_geometry

CAMERA = Camera(640, 480, 400.0, 400.0, 320.0, 240.0)
BEHIND = Pose.from_start(0.0, -2.0, 0.0)


def rig(**mount: float) -> FixedRig:
    return FixedRig(CAMERA, CameraMount(**mount))


@given(poses_behind_the_goal(), floats(-0.5, 0.5), floats(-0.3, 0.3))
def test_bearings_are_those_of_the_paper_whatever_tilt_and_roll(pose, tilt, roll) -> None:
    truth, expected = true_geometry(rig(tilt=tilt, roll=roll), pose), Bearings.from_pose(pose)
    assert truth.error(expected.current, expected.desired) == pytest.approx(0.0, abs=1e-12)
    assert truth.baseline == pytest.approx(pose.distance)


def test_a_camera_that_looks_left_sees_the_goal_to_its_right() -> None:
    truth = true_geometry(rig(yaw=0.2), BEHIND)
    assert truth.current == pytest.approx(0.2)
    # The camera at the goal looks left as well: what is behind it is on its left, mirrored.
    assert truth.desired == pytest.approx(0.2 - math.pi)


def test_an_offset_counts_as_the_robot_turns() -> None:
    # Turned by 90 deg to the left at the goal, a camera 0.3 m ahead is 0.3 m to its left.
    turned = Pose(0.0, 0.0, math.pi)
    truth = true_geometry(rig(forward=0.3), turned)
    assert truth.baseline == pytest.approx(0.3 * math.sqrt(2.0))
    assert truth.desired == pytest.approx(-0.75 * math.pi)
    assert truth.current == pytest.approx(0.75 * math.pi)


def test_no_baseline_at_the_goal() -> None:
    assert true_geometry(rig(forward=0.3, yaw=0.1), DESIRED_POSE).baseline == 0.0


@pytest.mark.parametrize(
    ('current', 'desired', 'error'),
    [(0.1, math.pi, 0.1), (0.0, 0.2 - math.pi, 0.2), (math.pi, 0.0, math.pi)],
)
def test_the_error_is_the_larger_one_around_the_circle(current, desired, error) -> None:
    assert true_geometry(rig(), BEHIND).error(current, desired) == pytest.approx(error)


def test_what_was_not_measured_is_not_wrong() -> None:
    assert math.isnan(true_geometry(rig(), BEHIND).error(math.nan, 0.0))
