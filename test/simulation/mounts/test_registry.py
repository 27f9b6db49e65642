"""A rig of another kind: a class, a row in the table, and the world is seen through it."""

from dataclasses import dataclass, replace
import math

import numpy as np
import pytest

from visual_servo_epipolar.core.cameras.pinhole import Camera
from visual_servo_epipolar.core.geometry.motion import DESIRED_POSE, Pose
from visual_servo_epipolar.core.settings import setting
from visual_servo_epipolar.simulation.camera_simulator import CameraSimulator
from visual_servo_epipolar.simulation.mounts.camera_settings import CameraSettings
from visual_servo_epipolar.simulation.mounts.mounting import CameraMount
from visual_servo_epipolar.simulation.mounts.registry import SIMULATED_RIGS, SimulatedRigModel
from visual_servo_epipolar.simulation.mounts.simulated_rig import CameraPose
from visual_servo_epipolar.simulation.scenario import from_document, Scenario
from visual_servo_epipolar.simulation.views import points_of

SMALL = {
    'width': 160,
    'height': 120,
    'focal_length': 96.0,
    'principal_u': 79.5,
    'principal_v': 59.5,
    'noise': 0.0,
}
LEFT_TURNED = replace(DESIRED_POSE, theta=DESIRED_POSE.theta + math.radians(30.0))


@dataclass(frozen=True, kw_only=True)
class PannedSettings(CameraSettings):
    """A camera that looks aside."""

    pan: float = setting(0.0, 'Pan, to the left [rad]', low=-3.2, high=3.2, read_only=True)


@dataclass(frozen=True)
class PannedRig:
    """A camera above the axle that looks ``pan`` [rad] to the left of the heading."""

    camera: Camera
    pan: float

    def camera_pose(self, pose: Pose, frame: int | None = None) -> CameraPose:
        panned, mount = replace(pose, theta=pose.theta + self.pan), CameraMount()
        return CameraPose(mount.R_world_camera(panned), mount.centre(pose))


@pytest.fixture
def panned(monkeypatch: pytest.MonkeyPatch) -> Scenario:
    """Return a scenario whose camera looks 30 deg to the left."""
    row = SimulatedRigModel(
        PannedSettings, lambda settings: PannedRig(settings.camera, settings.pan)
    )
    monkeypatch.setitem(SIMULATED_RIGS, 'panned', row)
    camera = {'rig': 'panned', 'pan': math.radians(30.0), **SMALL}
    return from_document({'camera': camera}, 'test')


def test_images_are_taken_through_the_rig_of_the_scenario(panned: Scenario) -> None:
    ahead = CameraSimulator(from_document({'camera': SMALL}, 'test').camera)
    aside = CameraSimulator(panned.camera)
    np.testing.assert_array_equal(aside.photograph(), ahead.renderer.render(LEFT_TURNED))


def test_points_are_seen_through_the_rig_of_the_scenario(panned: Scenario) -> None:
    world = points_of(panned, 0)
    rays = (world.points - [0.0, 0.0, 0.6]) @ CameraMount().R_world_camera(LEFT_TURNED)
    pixels, visible = world.project(DESIRED_POSE)
    assert visible.all()
    expected = panned.camera.camera.pixels_of(rays[:, :2] / rays[:, 2:])
    np.testing.assert_allclose(pixels, expected, atol=1e-9)


def test_a_scenario_names_its_rig(panned: Scenario) -> None:
    assert panned.document()['camera']['rig'] == 'panned'
    assert from_document({'camera': {'rig': 'fixed'}}, 'test') == Scenario()
