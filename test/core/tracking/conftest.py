"""The room that trackers are tried in, as a camera of 640x480 sees it."""

import pytest

from visual_servo_epipolar.simulation.camera_simulator import CameraSimulator
from visual_servo_epipolar.simulation.cameras import CameraSettings


@pytest.fixture(scope='module')
def world() -> CameraSimulator:
    return CameraSimulator(
        CameraSettings(
            width=640, height=480, focal_length=384.6, principal_u=319.5, principal_v=239.5
        )
    )
