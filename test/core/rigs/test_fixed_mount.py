"""Mounts out of transforms: those of the simulation come back, others are refused."""

import math

from hypothesis import given
import numpy as np
import pytest
from strategies import floats

from visual_servo_epipolar.core.geometry.motion import Pose
from visual_servo_epipolar.core.rigs.fixed_mount import mount_of
from visual_servo_epipolar.core.servo.settings import ServoSettings
from visual_servo_epipolar.simulation.mounts.mounting import CameraMount

BASE = Pose(0.0, 0.0, 0.0)
BODY = np.eye(3)  # x forward, y left, z up: no optical frame


@given(
    tilt=floats(-0.7, 0.7),
    roll=floats(-0.7, 0.7),
    yaw=floats(-3.0, 3.0),
    forward=floats(-1.0, 1.0),
    left=floats(-1.0, 1.0),
)
def test_a_mount_comes_back_from_its_transform(tilt, roll, yaw, forward, left) -> None:
    rig = CameraMount(0.6, forward, tilt, roll, left, yaw)
    found = mount_of(rig.R_world_camera(BASE), rig.centre(BASE))
    assert (found.tilt, found.roll, found.yaw) == pytest.approx((tilt, roll, yaw), abs=1e-9)
    assert (found.forward, found.left) == pytest.approx((forward, left), abs=1e-12)


@pytest.mark.parametrize(
    ('rotation', 'message'),
    [
        (BODY, '90 deg up, an optical frame looks ahead'),
        (np.diag([1.0, -1.0, -1.0]), '90 deg down, an optical frame looks ahead'),
        (2.0 * np.eye(3), 'must be a rotation and a place'),
        (np.full((3, 3), math.nan), 'must be a rotation and a place'),
    ],
)
def test_what_is_no_mount_is_refused(rotation, message) -> None:
    with pytest.raises(ValueError, match=message):
        mount_of(rotation, np.zeros(3))


def test_settings_take_a_mount_and_stay_otherwise_the_same() -> None:
    before = ServoSettings(camera_left_deviation=0.01, k1=0.5)
    rig = CameraMount(0.6, 0.2, 0.3, -0.1, 0.05, 0.1)
    after = before.mounted(mount_of(rig.R_world_camera(BASE), rig.centre(BASE)))
    assert not before.mount_is_told
    assert after.mount_is_told
    assert (after.camera_tilt, after.camera_roll) == pytest.approx((0.3, -0.1))
    assert (after.camera_yaw, after.camera_forward) == pytest.approx((0.1, 0.2))
    assert after.camera_left == pytest.approx(0.05)
    assert (after.camera_left_deviation, after.k1) == (0.01, 0.5)


def test_a_mount_beyond_the_settings_is_refused() -> None:
    behind = CameraMount(yaw=math.pi)
    with pytest.raises(ValueError, match='camera_yaw'):
        ServoSettings().mounted(mount_of(behind.R_world_camera(BASE), behind.centre(BASE)))
