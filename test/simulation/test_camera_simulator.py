"""Simulated cameras: images at rest and after it, disturbances, and light of every kind."""

from dataclasses import replace

from durations import few_of
import numpy as np
import pytest

from visual_servo_epipolar.core.geometry.motion import DESIRED_POSE, Pose
from visual_servo_epipolar.simulation.camera_simulator import CameraSimulator
from visual_servo_epipolar.simulation.cameras import CameraSettings
from visual_servo_epipolar.simulation.disturbances import DisturbanceSettings
from visual_servo_epipolar.simulation.light import (
    Box,
    brightened,
    DAY,
    Exposure,
    HYSTERESIS,
    Lamp,
    Light,
    LIGHTS,
    LightSettings,
    STOP,
    Window,
)

SMALL = CameraSettings(
    width=160, height=128, focal_length=96.2, principal_u=79.2, principal_v=63.8
)
HERE, THERE = Pose.from_start(0.6, -3.0, 8.0), Pose.from_start(0.5, -2.9, 7.0)
PERSON = DisturbanceSettings(disturbed_from=0, person=0.8)


def afresh(settings: CameraSettings, pose: Pose, frame: int, **disturbances) -> np.ndarray:
    return CameraSimulator(settings, **disturbances).capture(pose, frame)


@pytest.mark.parametrize('changes', [{}, {'noise': 0.0}, {'jitter': 0.01}, {'gain_drift': 0.1}])
@pytest.mark.parametrize('disturbances', few_of([DisturbanceSettings(), PERSON], keep=(1,)))
def test_a_camera_that_stands_takes_the_images_of_one_that_came(changes, disturbances) -> None:
    settings = replace(SMALL, **changes)
    camera = CameraSimulator(settings, disturbances)
    for frame, pose in enumerate([HERE, HERE, HERE, THERE, HERE]):
        expected = afresh(settings, pose, frame, disturbances=disturbances)
        np.testing.assert_array_equal(camera.capture(pose, frame), expected)


def test_a_camera_that_stands_draws_the_room_once(monkeypatch: pytest.MonkeyPatch) -> None:
    camera, drawn = CameraSimulator(SMALL), []
    render = camera.renderer.render
    monkeypatch.setattr(
        camera.renderer, 'render', lambda *where: drawn.append(where) or render(*where)
    )
    for frame, pose in enumerate([HERE, HERE, HERE, THERE, HERE]):
        camera.capture(pose, frame)
    assert [pose for pose, *_ in drawn] == [HERE, THERE, HERE]


@pytest.mark.parametrize('noise', [0.0, 2.0])
def test_writing_into_an_image_spoils_no_other(noise: float) -> None:
    settings = replace(SMALL, noise=noise)
    camera = CameraSimulator(settings)
    camera.capture(HERE, 0)[:] = 0
    np.testing.assert_array_equal(camera.capture(HERE, 1), afresh(settings, HERE, 1))


def test_cameras_of_two_rooms_and_seeds_keep_apart() -> None:
    settings = [SMALL, replace(SMALL, seed=1), replace(SMALL, scene_seed=2)]
    cameras = [CameraSimulator(each) for each in settings]
    images = [[camera.capture(HERE, frame) for camera in cameras] for frame in range(2)]
    for k in reversed(range(3)):  # one room is kept
        np.testing.assert_array_equal(images[1][k], afresh(settings[k], HERE, 1))


def test_a_floor_that_begins_to_shake_moves_a_camera_that_stands() -> None:
    camera, shaken = CameraSimulator(SMALL), replace(SMALL, jitter=0.02)
    camera.capture(HERE, 0)
    camera.settings = shaken
    np.testing.assert_array_equal(camera.capture(HERE, 1), afresh(shaken, HERE, 1))


def test_disturbances_begin_and_end_before_a_camera_that_stands() -> None:
    camera = CameraSimulator(SMALL)
    for frame, disturbances in enumerate([DisturbanceSettings(), PERSON, DisturbanceSettings()]):
        camera.disturb(disturbances)
        expected = afresh(SMALL, HERE, frame, disturbances=disturbances)
        np.testing.assert_array_equal(camera.capture(HERE, frame), expected)


CAMERA = CameraSettings(
    width=160, height=128, focal_length=96.0, principal_u=80.0, principal_v=64.0, scene='plain'
)
UP = np.array([0.0, 0.0, 1.0])
CRATE = Box(np.array([0.0, 0.0, 1.0]), np.eye(3), np.array([0.5, 0.5, 0.2]))


def image(light: str) -> np.ndarray:
    return CameraSimulator(CAMERA, None, LightSettings(light=light)).capture(DESIRED_POSE, 0)


def test_a_lamp_falls_off_with_distance_and_slant() -> None:
    lamp = Lamp((0.0, 0.0, 2.0), 1.0)
    below, aside = lamp.on(np.array([[0.0, 0.0, 0.0], [2.0, 0.0, 0.0]]), UP, ())
    # cos 45 deg, and twice the square of the distance
    assert aside / below == pytest.approx(np.sqrt(0.5) / 2.0, rel=0.03)
    assert lamp.on(np.zeros((1, 3)), -UP, ()) == 0.0


def test_a_box_casts_its_shadow_where_it_hides_the_lamp() -> None:
    lamp, points = Lamp((0.0, 0.0, 3.0), 1.0), np.array([[0.0, 0, 0], [1.5, 0, 0], [0, 0, 2.0]])
    assert (lamp.on(points, UP, (CRATE,)) > 0.0).tolist() == [False, True, True]


def test_the_sun_comes_through_the_window_alone() -> None:
    window = Window((-5.5, 0.0, 1.5), (1.0, 1.0), sky=0.0, sun=2.0, sun_from=(-1.0, 0.0, 1.0))
    floor = np.array([[-4.0, 0.0, 0.0], [-2.0, 0.0, 0.0], [-4.0, 1.0, 0.0]])
    np.testing.assert_allclose(window.on(floor, UP, ()), [2.0 * np.sqrt(0.5), 0.0, 0.0])


def test_the_side_that_a_lamp_stands_on_is_brighter_in_the_image() -> None:
    means = [image(name).mean(axis=0) for name in ('ceiling', 'lamp_right', 'lamp_side')]
    usual, right, side = means
    slope = np.linspace(-1.0, 1.0, len(usual))
    assert slope @ (right / right.mean() - usual / usual.mean()) > 5.0
    assert slope @ (side / side.mean() - usual / usual.mean()) < -5.0


def test_a_window_opens_in_view() -> None:
    assert (image('window') == 255).mean() > (image('ceiling') == 255).mean() + 0.01


def test_lights_of_the_day_take_turns_by_the_seed() -> None:
    each = LightSettings(light='each')
    assert [each.light_of(seed).name for seed in range(7)] == [*DAY, *DAY[:2]]
    assert set(DAY) < set(LIGHTS)


SCENE = np.tile(np.linspace(20, 180, 64).astype(np.uint8), (64, 1))  # mean grey 100
AUTO = LightSettings(exposure='auto')


def view(level: float) -> tuple[np.ndarray, Light]:
    return SCENE, replace(LIGHTS['ceiling'], level=level)


@pytest.mark.parametrize(('level', 'rounding'), [(1.0, 0.0), (0.5, 1.0)])
def test_a_fixed_exposure_takes_the_light_as_it_is(level: float, rounding: float) -> None:
    taken, gain = Exposure(LightSettings()).take(*view(level))
    np.testing.assert_allclose(taken / level, SCENE, atol=rounding)
    assert gain == 1.0


@pytest.mark.parametrize('light', [0.3, 0.6, 1.0, 2.0])
def test_it_has_settled_on_the_first_image(light: float) -> None:
    taken, gain = Exposure(AUTO).take(*view(light))
    assert 100.0 * 2.0 ** (-HYSTERESIS / STOP) <= taken.mean() + 0.5
    assert taken.mean() - 0.5 <= 100.0 * 2.0 ** (HYSTERESIS / STOP)
    assert (gain > 1.0) == (light < 1.0)


def test_it_follows_a_change_by_its_step_at_most_and_one_image_late() -> None:
    exposure = Exposure(AUTO)
    exposure.take(*view(1.0))
    means = [exposure.take(*view(0.25))[0].mean() for _ in range(12)]
    ratios = np.array(means[1:]) / means[:-1]
    assert means[0] == pytest.approx(25.0, abs=1.0)
    assert ratios.max() < 2.0 ** (0.25 + 1.0 / STOP)
    assert ratios[:6].min() > 1.1
    assert means[-1] > 100.0 * 2.0 ** (-HYSTERESIS / STOP) - 1.0


def test_its_gain_ends_at_the_limit() -> None:
    taken, gain = Exposure(AUTO).take(*view(0.05))
    assert gain == 4.0
    assert taken.mean() == pytest.approx(20.0, abs=1.0)


def test_noise_grows_with_the_gain() -> None:
    def noise(light: str) -> float:
        simulator = CameraSimulator(CAMERA, None, LightSettings(light=light, exposure='auto'))
        one, other = (simulator.capture(DESIRED_POSE, frame).astype(float) for frame in (1, 2))
        return float((one - other).std())

    assert noise('dark') / noise('ceiling') == pytest.approx(4.0, rel=0.15)


def test_a_window_stays_white_in_a_short_exposure() -> None:
    image = np.array([[255, 254, 100]], np.uint8)
    assert brightened(image, 0.25, glare=True).tolist() == [[255, 64, 25]]
    assert brightened(image, 0.25).tolist() == [[64, 64, 25]]


def test_an_exposure_that_is_set_live_goes_on_from_where_it_is() -> None:
    simulator = CameraSimulator(CAMERA, None, AUTO)
    means = [simulator.capture(DESIRED_POSE, 0).mean()]
    simulator.relight(replace(AUTO, light='dark'))
    means += [simulator.capture(DESIRED_POSE, frame).mean() for frame in range(1, 4)]
    assert means[1] < 0.3 * means[0]
    assert means[1] < means[2] < means[3] < 0.6 * means[0]
