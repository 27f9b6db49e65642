"""Recipe of a head: another package brings one that pans, and the servo drives with it."""

from dataclasses import dataclass, replace
import math
from typing import NamedTuple

import numpy as np
import pytest

from visual_servo_epipolar.core.arrays import FloatArray
from visual_servo_epipolar.core.geometry.motion import Pose
from visual_servo_epipolar.core.rigs.rig import (
    AT_REST,
    Edges,
    Gaze,
    HeadCommand,
    HeadLimits,
    Joints,
    Lean,
)
from visual_servo_epipolar.core.servo.run_log import summarise
from visual_servo_epipolar.core.servo.settings import ServoSettings
from visual_servo_epipolar.core.servo.state import ServoState
from visual_servo_epipolar.core.servo.supervisor import step
from visual_servo_epipolar.core.twoview.observation import Observation
from visual_servo_epipolar.simulation.cameras import CameraSettings, SIMULATED_RIGS
from visual_servo_epipolar.simulation.rigs import CameraPose, SimulatedRig
from visual_servo_epipolar.simulation.scenario import from_document
from visual_servo_epipolar.simulation.views import drive

SWING, PERIOD = 0.2, 50.0  # of the head [rad, frames]


class PanHead:
    """Head that turns about the vertical, and looks at the middle of what it sees."""

    turn_rate, search_time = 0.0, 0.0  # it follows no turn of the base

    def __init__(self, limits: HeadLimits) -> None:
        self.limits, self.photograph = limits, joints_at(-1)

    def rays(self, rays: FloatArray, joints: Joints, lean: Lean | None = None) -> FloatArray:
        cos, sin = math.cos(joints.pan), math.sin(joints.pan)
        return rays @ np.array([[cos, 0.0, sin], [0.0, 1.0, 0.0], [-sin, 0.0, cos]])

    def edges(self, edges: Edges, joints: Joints) -> Edges:
        return edges[0] - joints.pan, edges[1] - joints.pan

    def reach(self, edges: Edges) -> Edges:  # it swings and does not obey: what it always sees
        return edges[0] + SWING, edges[1] - SWING

    def head_command(self, gaze: Gaze) -> HeadCommand:
        rays = gaze.current
        bearing = float(np.median(np.arctan2(rays[:, 0], rays[:, 2]))) if len(rays) else 0.0
        return HeadCommand(pan=-bearing)


def joints_at(frame: int | None) -> Joints:
    """Return the angles of a head that swings whatever it is told, from rest at the photograph."""
    return AT_REST if frame is None else Joints(SWING * math.sin(math.tau * (frame + 1) / PERIOD))


class SwingingRig(NamedTuple):
    fixed: SimulatedRig

    @property
    def camera(self):
        return self.fixed.camera

    def camera_pose(
        self, pose: Pose, frame: int | None = None, joints: Joints = AT_REST
    ) -> CameraPose:
        panned = replace(pose, theta=pose.theta + joints_at(frame).pan)
        axes = self.fixed.camera_pose(panned).R_world_camera
        return CameraPose(axes, self.fixed.mount.centre(pose))


class SwingingSettings(CameraSettings):
    def rig(self) -> SwingingRig:
        return SwingingRig(SimulatedRig(self.camera, self.mount))


@dataclass
class Control:
    """The servo with the angles of the joints beside each image."""

    commands: list[HeadCommand | None]

    def __call__(
        self, state: ServoState, seen: Observation, settings: ServoSettings
    ) -> ServoState:
        rig, frame = settings.carrier, len(self.commands)
        if settings.rig == 'pan':
            seen = seen.on_rig(rig, joints_at(frame))
        state = step(state, seen, settings)
        self.commands.append(state.command.head)
        return state


@pytest.fixture()
def scenario(install, monkeypatch):
    install('rigs', 'pan', f'{__name__}:PanHead')
    monkeypatch.setitem(SIMULATED_RIGS, 'swinging', SwingingSettings)
    return from_document({'camera': {'rig': 'swinging'}}, 'test')


@pytest.mark.parametrize('rig', ['pan', 'fixed'])
def test_the_servo_drives_with_a_head_of_another_package(scenario, rig: str) -> None:
    scenario, control = scenario.with_servo({'rig': rig}), Control([])
    result = summarise(drive(scenario, (0.4, -2.5, 5.0), 3, control=control))
    if rig == 'fixed':  # who knows of no joints takes the swing for the robot's
        assert result['outcome'] != 'arrived' or result['position_error_m'] > 0.02
        assert set(control.commands) == {None}
        return
    assert result['outcome'] == 'arrived', result['reason']
    assert result['position_error_m'] < 0.005
    pans = [command.pan for command in control.commands if command is not None]
    assert len(pans) == len(control.commands)
    assert max(pans) > 0.05
