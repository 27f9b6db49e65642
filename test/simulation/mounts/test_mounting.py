"""The camera on its base, and its sensor."""

from dataclasses import replace
import math

from hypothesis import given
from hypothesis import strategies as st
import numpy as np
import pytest
from strategies import floats, poses

from visual_servo_epipolar.core.cameras.pinhole import Camera
from visual_servo_epipolar.core.cameras.registry import camera_of_size
from visual_servo_epipolar.core.geometry.motion import DESIRED_POSE, Pose
from visual_servo_epipolar.core.rigs.rig import HeadCommand, Joints
from visual_servo_epipolar.core.tracking.canvas import Canvas
from visual_servo_epipolar.simulation.cameras import PanTiltSettings, SimulatedHead
from visual_servo_epipolar.simulation.rigs import CameraMount, floor_jitter, leaned, SimulatedRig
from visual_servo_epipolar.simulation.sensor import DESIRED_FRAME, Sensor

CAMERA = Camera(1280, 1024, 769.0, 769.0, 635.0, 512.0)


@pytest.mark.parametrize(
    ('mount', 'centre'),
    [
        (CameraMount(height=0.4, forward=0.2, yaw=0.2), (0.8, 2.0, 0.4)),
        (CameraMount(height=0.4, left=0.1), (1.0, 1.9, 0.4)),
        (CameraMount(height=0.4, forward=0.2, left=-0.1), (0.8, 2.1, 0.4)),
    ],
)
def test_the_mount_carries_the_camera(mount: CameraMount, centre: tuple[float, ...]) -> None:
    np.testing.assert_allclose(mount.centre(Pose(1.0, 2.0, math.pi)), centre, atol=1e-12)


@given(poses(), floats(-0.4, 0.4), floats(-0.4, 0.4))
def test_axes_are_a_rotation(pose: Pose, tilt: float, roll: float) -> None:
    axes = CameraMount(tilt=0.1, roll=-0.1, yaw=0.2).R_world_camera(pose, tilt=tilt, roll=roll)
    np.testing.assert_allclose(axes.T @ axes, np.eye(3), atol=1e-12)
    assert np.linalg.det(axes) > 0.0


def test_tilt_looks_down_and_roll_lowers_the_right_side() -> None:
    down = CameraMount(tilt=0.1).R_world_camera(DESIRED_POSE)
    assert down[2, 2] == pytest.approx(-math.sin(0.1))
    rolled = CameraMount(roll=0.1).R_world_camera(DESIRED_POSE)
    assert rolled[2, 0] == pytest.approx(-math.sin(0.1))


@given(poses(), floats(-0.8, 0.8))
def test_yaw_turns_the_camera_to_the_left_as_a_turn_of_the_robot_does(pose, yaw) -> None:
    leaning = {'tilt': 0.3, 'roll': -0.1}
    turned = CameraMount(**leaning).R_world_camera(replace(pose, theta=pose.theta + yaw))
    np.testing.assert_array_equal(CameraMount(**leaning, yaw=yaw).R_world_camera(pose), turned)


@given(st.integers(0, 2**31 - 1), st.integers(-1, 10**6))
def test_an_even_floor_shakes_nothing_and_an_uneven_one_always_the_same(seed, frame) -> None:
    assert floor_jitter(0.0, seed, frame) == (0.0, 0.0)
    once = floor_jitter(0.01, seed, frame)
    assert floor_jitter(0.01, seed, frame) == once
    assert floor_jitter(0.01, seed, frame + 1) != once


def test_jitter_has_the_deviation_asked_for_in_both_angles() -> None:
    angles = np.array([floor_jitter(0.002, 3, frame) for frame in range(-1, 3000)])
    # Of 3000 numbers the deviation is known to 1.3 %, their correlation to 0.018.
    np.testing.assert_allclose(angles.std(axis=0), 0.002, rtol=0.05)
    assert abs(np.corrcoef(angles.T)[0, 1]) < 0.08


@given(poses(), st.integers(0, 1000))
def test_bumps_lean_the_robot_by_their_slope_wherever_it_looks(pose: Pose, seed: int) -> None:
    rig = SimulatedRig(CAMERA, CameraMount(height=0.0), seed=seed, bumps=0.005)

    def height(right: float, ahead: float) -> float:
        sin, cos = math.sin(pose.theta), math.cos(pose.theta)
        place = Pose(pose.x + right * sin + ahead * cos, pose.y - right * cos + ahead * sin, 0.0)
        return float(rig.camera_pose(place, 0).centre[2])

    axes = rig.camera_pose(pose, 3).R_world_camera
    climbs = 500.0 * (height(0.0, 0.001) - height(0.0, -0.001))
    banks = 500.0 * (height(0.001, 0.0) - height(-0.001, 0.0))
    assert axes[2, 2] == pytest.approx(climbs, abs=1e-4)
    assert axes[2, 0] == pytest.approx(banks, abs=1e-4)
    assert abs(height(0.0, 0.0)) <= 0.01
    assert rig.camera_pose(pose).centre[2] == 0.0


def test_a_camera_above_the_axle_moves_as_the_robot_leans() -> None:
    upright = SimulatedRig(CAMERA, CameraMount(height=0.6)).camera_pose(DESIRED_POSE)
    nods = leaned(upright, DESIRED_POSE, (-0.01, 0.0, 0.0))
    np.testing.assert_allclose(nods.centre, [0.0, 0.006, 0.6], atol=1e-4)
    assert nods.R_world_camera[2, 2] == pytest.approx(-0.01, abs=1e-5)


SIZE = 320, 160


def test_beside_the_seam_nothing_is_gone_by() -> None:
    camera = camera_of_size('equirectangular', SIZE)
    canvas = Canvas.of(camera, np.radians(10.0))
    bearings = np.radians([0.0, 75.0, 85.0, 95.0, 105.0, -95.0, 180.0])
    rays = np.column_stack([np.sin(bearings), 0.0 * bearings, np.cos(bearings)])
    pixels = camera.pixels(rays) + np.array(canvas.margins)
    assert canvas.shows(pixels).tolist() == [True, True, False, False, True, False, True]
    assert Canvas.of(camera).shows(pixels).all()


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


def test_a_head_turns_the_camera_about_the_mount() -> None:
    rig, panned = PanTiltSettings(tilt=0.1).rig(), CameraMount(tilt=0.1, yaw=-0.05)
    turned = rig.camera_pose(DESIRED_POSE, joints=Joints(-0.05)).R_world_camera
    np.testing.assert_array_equal(turned, panned.R_world_camera(DESIRED_POSE))


def test_readings_repeat_with_the_seed() -> None:
    first, again = (SimulatedHead(PanTiltSettings(), seed=4) for _ in range(2))
    readings = [first.read() for _ in range(3)]
    assert readings == [again.read() for _ in range(3)]
    assert len(set(readings)) == 3


SENSOR_SIZE = (320, 240)
GREY = np.full((240, 320), 128, dtype=np.uint8)


def sensor(seed: int = 7, **settings: float) -> Sensor:
    return Sensor(SENSOR_SIZE, seed, **settings)


def test_a_perfect_sensor_changes_nothing() -> None:
    np.testing.assert_array_equal(sensor().capture(GREY, 3), GREY)


@pytest.mark.parametrize('noise', (1.0, 2.0, 8.0))
def test_noise_has_the_deviation_asked_for(noise: float) -> None:
    error = sensor(noise=noise).capture(GREY, 0).astype(float) - 128.0
    assert abs(error.mean()) < 0.1
    # Rounding to whole grey levels adds a variance of 1/12.
    assert error.std() == pytest.approx(np.sqrt(noise**2 + 1.0 / 12.0), rel=0.03)


def test_noise_of_two_frames_is_unrelated() -> None:
    camera = sensor(noise=5.0)
    frames = [camera.capture(GREY, k).astype(float).ravel() for k in (DESIRED_FRAME, 0, 1, 2)]
    related = np.corrcoef(frames) - np.eye(4)
    assert np.abs(related).max() < 0.03


def test_the_same_seed_and_frame_give_the_same_image() -> None:
    settings = {'noise': 3.0, 'gain_drift': 0.1, 'blur': 0.7}
    one, other = sensor(**settings), sensor(**settings)
    one.capture(GREY, 4)
    np.testing.assert_array_equal(one.capture(GREY, 5), other.capture(GREY, 5))


def test_the_gain_drifts_within_its_amplitude() -> None:
    camera = sensor(gain_drift=0.2)
    gains = np.array([camera.capture(GREY, k).mean() / 128.0 for k in range(100)])
    assert np.abs(gains - 1.0).max() <= 0.2 + 0.5 / 128.0
    assert gains.max() - gains.min() > 0.2


def test_blur_spreads_a_point() -> None:
    point = np.zeros_like(GREY)
    point[100, 100] = 255
    assert 10 < sensor(blur=1.0).capture(point, 0)[100, 100] < 60


def test_noise_is_added_with_its_sign_and_cut_off_at_black_and_white() -> None:
    camera, grey = sensor(noise=20.0), np.arange(256, dtype=np.uint8)
    added = camera.capture(GREY, 5).astype(int) - 128
    bands = np.resize(grey, GREY.shape)
    assert np.abs(added).max() < 128
    assert min((added < 0).mean(), (added > 0).mean()) > 0.4
    np.testing.assert_array_equal(camera.capture(bands, 5), np.clip(bands + added, 0, 255))
