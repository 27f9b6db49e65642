"""The room that trackers are tried in, as a camera of 640x480 sees it."""

import pytest
from small_cameras import sized

from visual_servo_epipolar.simulation.camera_simulator import CameraSimulator
from visual_servo_epipolar.simulation.cameras import CameraSettings


@pytest.fixture(scope='module')
def world() -> CameraSimulator:
    return CameraSimulator(CameraSettings(**sized(640, 480, 384.6, 319.5, 239.5)))
