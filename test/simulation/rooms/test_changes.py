"""Changes of a room: another thing in the run than in the photograph, all else as it was."""

import numpy as np
import pytest

from visual_servo_epipolar.core.geometry.motion import DESIRED_POSE
from visual_servo_epipolar.simulation.camera_simulator import CameraSimulator
from visual_servo_epipolar.simulation.light.lights import LightSettings
from visual_servo_epipolar.simulation.mounts.camera_settings import CameraSettings

CAMERA = CameraSettings(
    width=160,
    height=128,
    focal_length=96.0,
    principal_u=80.0,
    principal_v=64.0,
    scene='plain',
    noise=0.0,
)


def taken(**light: str) -> tuple[np.ndarray, np.ndarray]:
    """Return the photograph, and an image of the run from the same place."""
    simulator = CameraSimulator(CAMERA, None, LightSettings(**light))
    return simulator.photograph().astype(int), simulator.capture(DESIRED_POSE, 0).astype(int)


@pytest.mark.parametrize(('changed', 'most'), [('monitor', 0.1), ('door', 0.05)])
def test_what_changed_is_another_in_the_run_and_nothing_else_is(changed: str, most: float) -> None:
    photograph, image = taken(changed=changed)
    differs = np.abs(image - photograph) > 8
    assert 0.002 < differs.mean() < most
    usual, _ = taken()
    assert 0.0 < (np.abs(photograph - usual) > 8).mean() < most


def test_a_monitor_glows_where_the_room_is_dark() -> None:
    photograph, image = taken(changed='monitor', light='dark')
    monitor = np.s_[59:67, 90:103]
    assert image[monitor].mean() > 2.0 * np.median(image)


def test_a_window_opens_in_view() -> None:
    photograph, image = taken(light='window')
    assert (image == 255).mean() > (photograph == 255).mean() + 0.01
