"""Routes of a camera that sees all around: found at any heading, and driven from there."""

import math
from pathlib import Path

import numpy as np
import pytest

from visual_servo_epipolar.core.errors import InputError
from visual_servo_epipolar.core.geometry.motion import Pose, STANDSTILL
from visual_servo_epipolar.core.routes.run import RouteRun
from visual_servo_epipolar.core.routes.settings import FollowSettings
from visual_servo_epipolar.core.servo.settings import ServoSettings
from visual_servo_epipolar.simulation.camera_simulator import CameraSimulator
from visual_servo_epipolar.simulation.mounts.camera_settings import CameraSettings
from visual_servo_epipolar.simulation.routes import (
    kidnap,
    repeat,
    rounded,
    route_scenario,
    Taught,
    teach,
)
from visual_servo_epipolar.simulation.scenario import load, Scenario

PANORAMA = CameraSettings(width=640, height=320, distortion_model='equirectangular')
SCENARIO = route_scenario(Scenario(camera=PANORAMA).with_servo({'law': 'smooth'}), 1)
TURNED = Pose(3.15, -3.6, -1.1)  # 0.15 m beside the way, 153 deg off its heading


@pytest.fixture(scope='module')
def taught() -> Taught:
    return teach(SCENARIO, rounded(((3.0, -3.9), (3.0, -3.1), (3.0, -2.4))))


def test_it_is_found_at_any_heading(taught: Taught) -> None:
    found = kidnap(SCENARIO, taught, 3, 1)
    assert (found.right, found.wrong) == (3, 0)


def test_its_lens_is_not_learnt_as_its_width_is_360_deg(taught: Taught) -> None:
    lenses = [view.structure.shared[2] for view in taught.route.views]
    assert np.abs(lenses).max() < 1e-3


def test_it_turns_to_the_way_where_it_stands(taught: Taught) -> None:
    simulator = CameraSimulator(SCENARIO.camera)
    run = RouteRun(taught.route, FollowSettings(), SCENARIO.servo)
    steps = [run.step(simulator.capture(TURNED, k), round(k * 9e7)) for k in range(3)]
    assert steps[1].twist == STANDSTILL  # it begins with the ramp of the base
    assert steps[-1].progress is not None and steps[-1].progress.inliers > 20, steps[-1]
    assert math.degrees(steps[-1].progress.turn) == pytest.approx(-153.0, abs=1.0)
    assert steps[-1].twist.angular > 0.0 and not any(step.twist.linear for step in steps)


def test_a_base_that_steers_does_not_turn_and_says_so(taught: Taught) -> None:
    car = ServoSettings(law='smooth', base='car', max_curvature=1.6)
    run = RouteRun(taught.route, FollowSettings(), car)
    step = run.step(CameraSimulator(SCENARIO.camera).capture(TURNED, 0), 0)
    assert step.phase == 'failed' and 'does not turn in place' in step.reason


@pytest.mark.long
def test_a_way_is_repeated_from_where_it_faces_back(taught: Taught) -> None:
    log = repeat(SCENARIO.seeded(5), taught, FollowSettings(), start=TURNED)
    assert log.outcome == 'arrived', log.reason
    assert log.station[0] < 3e-3 and not log.is_wrong


def test_a_camera_on_a_head_is_refused_in_one_line() -> None:
    scenario = load(None, Path(__file__).parents[3] / 'config/rigs/pan.yaml')
    with pytest.raises(InputError, match='fixed to the base, got rig pan_tilt'):
        route_scenario(scenario, 1)
