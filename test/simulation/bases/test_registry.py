"""Bases and rigs of another kind: a class, a row in the table, and runs go through them."""

from dataclasses import dataclass, replace
import math

import numpy as np
import pytest
from small_cameras import sized

from visual_servo_epipolar.core.cameras.pinhole import Camera
from visual_servo_epipolar.core.geometry.motion import (
    DESIRED_POSE,
    integrate,
    Pose,
    Twist,
)
from visual_servo_epipolar.core.rigs.rig import AT_REST, Command, Joints
from visual_servo_epipolar.core.servo.run_log import summarise
from visual_servo_epipolar.core.settings import setting
from visual_servo_epipolar.simulation.bases import Pioneer, PioneerSettings, SIMULATED_BASES
from visual_servo_epipolar.simulation.camera_simulator import CameraSimulator
from visual_servo_epipolar.simulation.cameras import (
    CameraSettings,
    SIMULATED_RIGS,
)
from visual_servo_epipolar.simulation.rigs import CameraMount, CameraPose
from visual_servo_epipolar.simulation.scenario import from_document, Scenario
from visual_servo_epipolar.simulation.views import drive, points_of


@dataclass(frozen=True, kw_only=True)
class IdealSettings(PioneerSettings):
    """A base without inertia; ``gain`` is what becomes of a commanded speed."""

    gain: float = setting(1.0, 'True speed over the commanded one', low=0.1, high=2.0)

    def base(self, pose: Pose, *, seed: int, now_ns: int = 0) -> 'IdealBase':
        return IdealBase(self, pose, seed=seed, now_ns=now_ns)


class IdealBase(Pioneer):
    """Follows each command at once."""

    settings: IdealSettings

    def command(self, command: Command) -> None:
        gain, twist = self.settings.gain, command.twist
        self.twist = Twist(gain * twist.linear, gain * twist.angular)

    def advance(self, now_ns: int) -> None:
        self.pose = integrate(self.pose, self.twist, (now_ns - self.now_ns) / 1e9)
        self.now_ns = now_ns


@pytest.fixture
def ideal(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(SIMULATED_BASES, 'ideal', IdealSettings)


@pytest.mark.usefixtures('ideal')
def test_a_base_of_another_kind_drives_to_the_goal() -> None:
    scenario = from_document({'base': {'model': 'ideal', 'gain': 0.9}}, 'test')
    summary = summarise(drive(scenario, (1.0, -3.0, 0.0), 0))
    assert summary['outcome'] == 'arrived'
    # 0.2 px of noise on 60 features.
    assert summary['position_error_m'] < 0.005


@pytest.mark.usefixtures('ideal')
def test_a_scenario_tells_bases_apart_by_name() -> None:
    scenario = from_document({'base': {'model': 'ideal'}}, 'test')
    assert scenario.base == IdealSettings()
    assert scenario.document()['base'].items() > {'gain': 1.0, 'model': 'ideal'}.items()
    usual = {'base': {'model': 'pioneer'}, 'camera': {'rig': 'fixed'}}
    assert from_document(usual, 'test') == Scenario()


SMALL = {**sized(160, 120, 96.0, 79.5, 59.5), 'noise': 0.0}
LEFT_TURNED = replace(DESIRED_POSE, theta=DESIRED_POSE.theta + math.radians(30.0))


@dataclass(frozen=True)
class PannedRig:
    """A camera above the axle that looks ``pan`` [rad] to the left of the heading."""

    camera: Camera
    pan: float

    def camera_pose(
        self, pose: Pose, frame: int | None = None, joints: Joints = AT_REST
    ) -> CameraPose:
        panned, mount = replace(pose, theta=pose.theta + self.pan), CameraMount()
        return CameraPose(mount.R_world_camera(panned), mount.centre(pose))


@dataclass(frozen=True, kw_only=True)
class PannedSettings(CameraSettings):
    """A camera that looks aside."""

    pan: float = setting(0.0, 'Pan, to the left [rad]', low=-3.2, high=3.2, read_only=True)

    def rig(self) -> PannedRig:
        return PannedRig(self.camera, self.pan)


@pytest.fixture
def panned(monkeypatch: pytest.MonkeyPatch) -> Scenario:
    """Return a scenario whose camera looks 30 deg to the left."""
    monkeypatch.setitem(SIMULATED_RIGS, 'panned', PannedSettings)
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
