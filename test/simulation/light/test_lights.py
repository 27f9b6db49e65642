"""Named lights: what is lit from where, what lies in a shadow."""

import numpy as np
import pytest

from visual_servo_epipolar.core.geometry.motion import DESIRED_POSE
from visual_servo_epipolar.simulation.camera_simulator import CameraSimulator
from visual_servo_epipolar.simulation.light import (
    Box,
    DAY,
    Lamp,
    LIGHTS,
    LightSettings,
    Window,
)
from visual_servo_epipolar.simulation.mounts.camera_settings import CameraSettings

CAMERA = CameraSettings(
    width=160, height=128, focal_length=96.0, principal_u=80.0, principal_v=64.0, scene='plain'
)
UP, AHEAD = np.array([0.0, 0.0, 1.0]), np.array([0.0, -1.0, 0.0])
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
    usual, right, side = (
        image(name).mean(axis=0) for name in ('ceiling', 'lamp_right', 'lamp_side')
    )
    slope = np.linspace(-1.0, 1.0, len(usual))
    assert slope @ (right / right.mean() - usual / usual.mean()) > 5.0
    assert slope @ (side / side.mean() - usual / usual.mean()) < -5.0


def test_a_window_opens_in_view() -> None:
    assert (image('window') == 255).mean() > (image('ceiling') == 255).mean() + 0.01


def test_lights_of_the_day_take_turns_by_the_seed() -> None:
    each = LightSettings(light='each')
    assert [each.light_of(seed).name for seed in range(7)] == [*DAY, *DAY[:2]]
    assert set(DAY) < set(LIGHTS)
