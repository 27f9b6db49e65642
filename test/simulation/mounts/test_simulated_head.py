"""Simulated head: limits, speed, delay, and encoders that are noisy and off."""

import numpy as np
import pytest

from visual_servo_epipolar.core.geometry.motion import DESIRED_POSE
from visual_servo_epipolar.core.rigs.rig import HeadCommand, Joints
from visual_servo_epipolar.simulation.mounts.pan_tilt import (
    pan_tilt_rig,
    PanTiltSettings,
    SimulatedHead,
)
from visual_servo_epipolar.simulation.mounts.sensor import DESIRED_FRAME

MS = 1_000_000


def pans(settings: PanTiltSettings, command: HeadCommand, milliseconds: int) -> list[float]:
    head = SimulatedHead(settings, seed=4)
    head.command(command)
    found = []
    for now in range(10, milliseconds, 10):
        head.advance(now * MS)
        found.append(head.joints.pan)
    return found


def test_it_goes_there_at_its_speed_and_stops() -> None:
    settings = PanTiltSettings(head_speed=1.0, head_delay=0.1)
    found = pans(settings, HeadCommand(pan=0.8), 1500)
    assert found[8] == 0.0  # 90 ms: the command has not arrived
    assert max(np.diff(found)) <= 0.01 + 1e-9
    assert max(found) < 0.8 + 1e-6
    assert found[-1] == pytest.approx(0.8, abs=1e-6)


def test_it_stops_at_its_limits() -> None:
    assert pans(PanTiltSettings(head_pan_limit=0.3), HeadCommand(pan=-2.0), 1500)[-1] == (
        pytest.approx(-0.3, abs=1e-6)
    )


def test_an_encoder_is_off_and_the_head_with_it() -> None:
    settings = PanTiltSettings(head_encoder_offset=0.05, head_encoder_noise=0.0)
    head = SimulatedHead(settings, seed=4)
    head.command(HeadCommand(pan=0.4))
    head.advance(3000 * MS)
    assert head.read().pan == pytest.approx(0.4, abs=1e-6)
    assert head.joints.pan == pytest.approx(0.35, abs=1e-6)


def test_the_photograph_is_taken_where_encoders_read_zero() -> None:
    rig = pan_tilt_rig(PanTiltSettings(head_encoder_offset=0.05))
    photograph = rig.camera_pose(DESIRED_POSE, DESIRED_FRAME).R_world_camera
    turned = rig.turned(Joints(-0.05)).camera_pose(DESIRED_POSE).R_world_camera
    np.testing.assert_array_equal(photograph, turned)


def test_readings_repeat_with_the_seed() -> None:
    first, again = (SimulatedHead(PanTiltSettings(), seed=4) for _ in range(2))
    readings = [first.read() for _ in range(3)]
    assert readings == [again.read() for _ in range(3)]
    assert len(set(readings)) == 3
