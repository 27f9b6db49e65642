"""Pan-tilt head: rays of a virtual camera fixed to the base, and where it looks next."""

import math
import re

from hypothesis import given
import numpy as np
import pytest
from strategies import floats

from visual_servo_epipolar.core.geometry.motion import Pose, Twist
from visual_servo_epipolar.core.rigs.fixed_mount import (
    is_configured,
    Mount,
    mount_of,
    with_mount,
)
from visual_servo_epipolar.core.rigs.joint_history import BEYOND, HeadHistory, JointHistory
from visual_servo_epipolar.core.rigs.pan_tilt import PanTiltHead
from visual_servo_epipolar.core.rigs.rig import AT_REST, Gaze, HeadLimits, Joints
from visual_servo_epipolar.core.servo.settings import ServoSettings
from visual_servo_epipolar.simulation.rigs import CameraMount

BASE = Pose(0.0, 0.0, 0.3)
HEAD = PanTiltHead(HeadLimits())
NOTHING = np.empty((0, 3))


def rays_at(bearings) -> np.ndarray:
    angles = np.array(bearings)
    return np.stack([np.sin(angles), 0.0 * angles, np.cos(angles)], axis=1)


ANGLES = np.linspace(-0.3, 0.3, 7)
SCENE = rays_at(ANGLES)


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
    seen = rays_at(ANGLES + heading + bias)  # a turn left moves features right
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
    command = HEAD.head_command(Gaze(Joints(-1.7), rays_at(ANGLES + 2.2), SCENE))
    assert command.pan == HEAD.limits.pan_min
    assert -HEAD.limits.pan_speed <= command.pan_rate <= 0.0


def test_where_too_few_features_stay_in_view_it_searches_the_other_end() -> None:
    end = Joints(HEAD.limits.pan_max)
    few = rays_at(ANGLES - 2.0)
    pans = [
        HEAD.head_command(Gaze(end, few, SCENE, lost=0.1 * frame)).pan
        for frame in range(round(10.0 * HEAD.search_time))
    ]
    assert set(pans[:20]) == {end.pan}
    assert min(pans) < HEAD.limits.pan_min + 0.1


def test_a_head_slower_than_configured_comes_to_both_ends_of_its_range() -> None:
    pan, period, pans = 0.0, 0.1, []
    slow = period * HEAD.limits.pan_speed / 3.0
    for frame in range(round(7.0 * HEAD.search_time / period)):
        gaze = Gaze(Joints(pan), NOTHING, NOTHING, lost=0.5 + period * frame)
        pan += min(max(HEAD.head_command(gaze).pan - pan, -slow), slow)
        pans.append(pan)
    assert max(pans) > HEAD.limits.pan_max - 0.2
    assert min(pans) < HEAD.limits.pan_min + 0.2


BODY = np.eye(3)  # x forward, y left, z up: no optical frame


def mounted(rig: CameraMount) -> Mount:
    """Return the mount by the transform of a camera."""
    return mount_of(rig.R_world_camera(Pose(0.0, 0.0, 0.0)), rig.centre(Pose(0.0, 0.0, 0.0)))


@given(
    tilt=floats(-0.7, 0.7),
    roll=floats(-0.7, 0.7),
    yaw=floats(-3.0, 3.0),
    forward=floats(-1.0, 1.0),
    left=floats(-1.0, 1.0),
)
def test_a_mount_comes_back_from_its_transform(tilt, roll, yaw, forward, left) -> None:
    found = mounted(CameraMount(0.6, forward, tilt, roll, left, yaw))
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
    after = with_mount(before, mounted(CameraMount(0.6, 0.2, 0.3, -0.1, 0.05, 0.1)))
    assert not is_configured(before)
    assert is_configured(after)
    assert (after.camera_tilt, after.camera_roll) == pytest.approx((0.3, -0.1))
    assert (after.camera_yaw, after.camera_forward) == pytest.approx((0.1, 0.2))
    assert after.camera_left == pytest.approx(0.05)
    assert (after.camera_left_deviation, after.k1) == (0.01, 0.5)


def test_a_mount_beyond_the_settings_is_refused() -> None:
    with pytest.raises(ValueError, match='camera_yaw'):
        with_mount(ServoSettings(), mounted(CameraMount(yaw=math.pi)))


MS = 1_000_000


def history(*stamps_ms: int, rate: float = 2.0) -> JointHistory:
    """Return the history of a pan joint that turns at ``rate`` [rad/s]."""
    found = JointHistory('pan', rate, (-1000.0, 1000.0))
    for stamp in stamps_ms:
        assert found.add(stamp * MS, rate * stamp / 1000.0) == ''
    return found


@given(milliseconds=floats(1000.0, 1180.0))
def test_between_readings_and_shortly_after_angles_go_on(milliseconds: float) -> None:
    angle = history(*range(1000, 1101, 20)).at(round(milliseconds * MS))
    assert angle == pytest.approx(2.0 * milliseconds / 1000.0, abs=1e-8)


@pytest.mark.parametrize(
    ('stamps', 'image', 'words'),
    [
        ((), 1000, 'no angle of pan yet'),
        ((1000, 1020), 1200, 'older than the image'),
        ((1000, 1020), 900, 'begin 0.10 s after the image'),
        ((1000, 1300), 1150, 'silent for 0.30 s'),
        (tuple(range(1000, 1620, 20)), 1050, '0.55 s newer than the image'),
    ],
)
def test_a_missing_angle_is_explained(stamps: tuple[int, ...], image: int, words: str) -> None:
    found = history(*stamps, rate=0.1)
    assert words in found.trouble(image * MS)


def test_a_clock_that_is_set_back_begins_it_anew() -> None:
    found = history(1000, 1020)
    assert 'went back' in found.add(500 * MS, -3.0)
    assert found.at(500 * MS) == -3.0


@pytest.mark.parametrize('turn', [0.2, -3.0])
def test_after_a_leap_nothing_is_known_for_good(turn: float) -> None:
    found = history(1000, 1020)
    pan = 2.0 * 1.02 + turn
    assert 'leap by' in found.add(1040 * MS, pan)
    for stamp in range(1060, 2000, 20):
        assert found.add(stamp * MS, pan) == ''
        assert 'call ~/reset' in found.trouble(stamp * MS)


def test_twice_the_speed_of_the_head_is_no_leap_and_no_number_no_angle() -> None:
    found = history(1000, 1020)
    assert found.add(1070 * MS, 2.0 * 1.02 + 0.2) == ''
    assert 'finite' in found.add(1090 * MS, math.nan)


@given(late=floats(-500.0, 100.0))
def test_joints_of_separate_messages_are_merged(late: float) -> None:
    head = HeadHistory(('pan', 'tilt'), 2.0, (-1.0, 1.0))
    image = 2000 * MS
    for stamp in range(1000, 2001, 100):
        assert head.add(stamp * MS, {'pan': 0.1}) == ''
    assert head.missing == ['tilt'] and head.trouble(image) == 'no angle of tilt yet'
    assert head.at(image) is None
    for stamp in range(1000, 2001, 100):
        assert head.add(stamp * MS - round(late * MS), {'tilt': 0.2, 'wheel': 9.0}) == ''
    assert head.at(image) == pytest.approx(Joints(0.1, 0.2))


@pytest.mark.parametrize('silent', ['pan', 'tilt'])
def test_a_joint_that_stays_away_is_named(silent: str) -> None:
    head = HeadHistory(('pan', 'tilt'), 2.0, (-1.0, 1.0))
    for stamp in range(1000, 1401, 100):
        head.add(stamp * MS, {name: 0.0 for name in ('pan', 'tilt') if name != silent})
        if stamp <= 1200:
            head.add(stamp * MS, {silent: 0.0})
    assert f'angles of {silent} are 0.20 s older' in head.trouble(1400 * MS)
    assert head.at(1400 * MS) is None and head.at(1200 * MS) == Joints(0.0, 0.0)


@pytest.mark.parametrize(
    ('name', 'wrong', 'right'),
    [('pan', 45.0, 1.0), ('pan', 2045.0, -1.0 - BEYOND), ('tilt', 30.0, 1.2)],
)
def test_angles_beyond_the_range_are_asked_about_and_not_taken(name, wrong, right) -> None:
    head = HeadHistory(('pan', 'tilt'), 2.0, (-1.0, 1.0))
    asked = f'the angle of {name} must lie within .* got {wrong:g}: degrees, or ticks'
    assert re.search(asked, head.add(1000 * MS, {'pan': 0.0, 'tilt': 0.0, name: wrong}))
    assert re.search(asked, head.trouble()) and head.at(1000 * MS) is None
    assert head.add(1020 * MS, {'pan': 0.0, 'tilt': 0.0, name: right}) == ''
    assert head.at(1020 * MS) is not None


def test_angles_that_leap_out_of_the_range_are_not_known_before_a_reset() -> None:
    head = HeadHistory(('pan', ''), 2.0, (-1.0, 1.0))
    head.add(1000 * MS, {'pan': 0.1})
    assert head.at(1000 * MS) == Joints(0.1, 0.0)  # there is no tilt
    assert 'leap by 2044.90 rad' in head.add(1020 * MS, {'pan': 2045.0})
    assert head.add(1040 * MS, {'pan': 0.0}) == ''
    assert head.at(1040 * MS) is None and 'call ~/reset' in head.trouble(1040 * MS)
