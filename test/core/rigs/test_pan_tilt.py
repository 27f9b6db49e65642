"""Pan-tilt head: rays of a virtual camera fixed to the base, and where it looks next."""

import math

from hypothesis import given
import numpy as np
import pytest
from strategies import floats

from visual_servo_epipolar.core.geometry.motion import Pose, Twist
from visual_servo_epipolar.core.rigs.pan_tilt import PanTiltHead
from visual_servo_epipolar.core.rigs.rig import AT_REST, Gaze, HeadLimits, Joints
from visual_servo_epipolar.simulation.mounts.mounting import CameraMount

BASE = Pose(0.0, 0.0, 0.3)
HEAD = PanTiltHead(HeadLimits())
NOTHING = np.empty((0, 3))


def rays_at(bearings: list[float]) -> np.ndarray:
    angles = np.array(bearings)
    return np.stack([np.sin(angles), 0.0 * angles, np.cos(angles)], axis=1)


SCENE = rays_at([-0.3, -0.2, -0.1, 0.0, 0.1, 0.2, 0.3])


@given(
    pan=floats(-2.0, 2.0), tilt=floats(-0.5, 0.5), down=floats(-0.3, 0.3), roll=floats(-0.3, 0.3)
)
def test_rays_are_those_of_a_camera_that_no_joint_turns(pan, tilt, down, roll) -> None:
    head = PanTiltHead(HeadLimits(tilt=down, roll=roll))
    mount, rng = CameraMount(tilt=down, roll=roll), np.random.default_rng(3)
    world = rng.standard_normal((20, 3))
    turned = mount.R_world_camera(Pose(0.0, 0.0, BASE.theta + pan), tilt=tilt)
    virtual = head.rays(world @ turned, Joints(pan, tilt))
    np.testing.assert_allclose(virtual, world @ mount.R_world_camera(BASE), atol=1e-12)


def test_edges_move_with_the_head_and_reach_has_all_that_it_can_see() -> None:
    left, right = HEAD.edges((-0.6, 0.7), Joints(0.5))
    assert (left, right) == pytest.approx((-1.1, 0.2))
    limit = math.radians(100.0)
    assert HEAD.reach((-0.6, 0.7)) == pytest.approx((-0.6 - limit, 0.7 + limit))


@given(heading=floats(-1.5, 1.5), bias=floats(-0.3, 0.3))
def test_it_looks_where_the_photograph_looked(heading: float, bias: float) -> None:
    angles = np.array([-0.3, -0.2, -0.1, 0.0, 0.1, 0.2, 0.3])
    seen = rays_at((angles + heading + bias).tolist())  # a turn left moves features right
    command = HEAD.head_command(Gaze(AT_REST, seen, SCENE))
    assert command.pan == pytest.approx(max(-heading - bias, -HEAD.limits.pan_max), abs=1e-9)


def test_both_joints_turn_no_faster_than_the_head_can() -> None:
    head = PanTiltHead(HeadLimits(pan_speed=0.5))
    far = head.head_command(Gaze(Joints(1.5, -0.9), SCENE, SCENE))
    assert (far.pan_rate, far.tilt_rate) == (-0.5, 0.5)
    near = head.head_command(Gaze(Joints(0.0, 0.01), SCENE, SCENE))
    assert near.tilt_rate == pytest.approx(-0.04)


def test_it_leads_a_turn_of_the_base() -> None:
    gaze = Gaze(AT_REST, SCENE, SCENE, Twist(0.0, 0.4), period=0.1)
    command = HEAD.head_command(gaze)
    assert command.pan == pytest.approx(-0.4 * (HEAD.limits.latency + 0.1))
    assert command.pan_rate == pytest.approx(-0.4)


def test_wrong_matches_do_not_turn_it() -> None:
    seen = np.concatenate([SCENE, rays_at([2.0, -2.5])])
    desired = np.concatenate([SCENE, rays_at([0.0, 0.0])])
    assert HEAD.head_command(Gaze(AT_REST, seen, desired)).pan == pytest.approx(0.0)


def test_it_stays_within_its_limits() -> None:
    seen = rays_at((np.array([-0.3, -0.2, -0.1, 0.0, 0.1, 0.2, 0.3]) + 2.2).tolist())
    command = HEAD.head_command(Gaze(Joints(-1.7), seen, SCENE))
    assert command.pan == HEAD.limits.pan_min
    assert -HEAD.limits.pan_speed <= command.pan_rate <= 0.0


def test_it_searches_its_range_where_nothing_is_seen() -> None:
    times = np.linspace(0.0, HEAD.search_time, 400).tolist()
    pans = [HEAD.head_command(Gaze(AT_REST, NOTHING, NOTHING, lost=0.5 + t)).pan for t in times]
    assert max(pans) > HEAD.limits.pan_max - 0.05
    assert min(pans) < HEAD.limits.pan_min + 0.05
    steps = np.abs(np.diff(pans)) / (times[1] - times[0])
    assert steps.max() < HEAD.limits.pan_speed


def test_where_too_few_features_stay_in_view_it_searches_the_other_end() -> None:
    end = Joints(HEAD.limits.pan_max)
    few = rays_at([-2.3, -2.2, -2.1, -2.0, -1.9, -1.8, -1.7])
    pans = [
        HEAD.head_command(Gaze(end, few, SCENE, lost=0.1 * frame)).pan
        for frame in range(round(10.0 * HEAD.search_time))
    ]
    assert set(pans[:20]) == {end.pan}
    assert min(pans) < HEAD.limits.pan_min + 0.1


def test_a_head_slower_than_it_is_told_comes_to_both_ends_of_its_range() -> None:
    pan, period, pans = 0.0, 0.1, []
    slow = period * HEAD.limits.pan_speed / 3.0
    for frame in range(round(7.0 * HEAD.search_time / period)):
        gaze = Gaze(Joints(pan), NOTHING, NOTHING, lost=0.5 + period * frame)
        pan += min(max(HEAD.head_command(gaze).pan - pan, -slow), slow)
        pans.append(pan)
    assert max(pans) > HEAD.limits.pan_max - 0.2
    assert min(pans) < HEAD.limits.pan_min + 0.2
