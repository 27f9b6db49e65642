"""Exposure: fixed, or as it follows the light within its steps and limits."""

import numpy as np
import pytest

from visual_servo_epipolar.core.geometry.motion import DESIRED_POSE
from visual_servo_epipolar.simulation.camera_simulator import CameraSimulator
from visual_servo_epipolar.simulation.light.exposure import Exposure, HYSTERESIS, STOP
from visual_servo_epipolar.simulation.light.settings import LightSettings
from visual_servo_epipolar.simulation.mounts.camera_settings import CameraSettings

CAMERA = CameraSettings(
    width=160, height=128, focal_length=96.0, principal_u=80.0, principal_v=64.0, scene='plain'
)
SCENE = np.tile(np.linspace(20, 180, 64).astype(np.uint8), (64, 1))  # mean grey 100
AUTO = LightSettings(exposure='auto')


def test_a_fixed_exposure_leaves_the_usual_light_alone() -> None:
    taken, gain = Exposure(LightSettings()).take(SCENE, 1.0)
    assert taken is SCENE
    assert gain == 1.0


@pytest.mark.parametrize('light', [0.3, 0.6, 1.0, 2.0])
def test_it_has_settled_on_the_first_image(light: float) -> None:
    taken, gain = Exposure(AUTO).take(SCENE, light)
    assert 100.0 * 2.0 ** (-HYSTERESIS / STOP) <= taken.mean() + 0.5
    assert taken.mean() - 0.5 <= 100.0 * 2.0 ** (HYSTERESIS / STOP)
    assert (gain > 1.0) == (light < 1.0)


def test_it_follows_a_change_by_its_step_at_most_and_one_image_late() -> None:
    exposure = Exposure(AUTO)
    exposure.take(SCENE, 1.0)
    means = [exposure.take(SCENE, 0.25)[0].mean() for _ in range(12)]
    ratios = np.array(means[1:]) / means[:-1]
    assert means[0] == pytest.approx(25.0, abs=1.0)
    assert ratios.max() < 2.0 ** (AUTO.exposure_step + 1.0 / STOP)
    assert ratios[:6].min() > 1.1
    assert means[-1] > 100.0 * 2.0 ** (-HYSTERESIS / STOP) - 1.0


def test_its_gain_ends_at_the_limit() -> None:
    taken, gain = Exposure(AUTO).take(SCENE, 0.05)
    assert gain == 4.0
    assert taken.mean() == pytest.approx(20.0, abs=1.0)


def test_noise_grows_with_the_gain() -> None:
    def noise(light: str) -> float:
        simulator = CameraSimulator(CAMERA, None, LightSettings(light=light, exposure='auto'))
        one, other = (simulator.capture(DESIRED_POSE, frame).astype(float) for frame in (1, 2))
        return float((one - other).std())

    assert noise('dark') / noise('ceiling') == pytest.approx(4.0, rel=0.15)


def test_equal_inputs_give_equal_images() -> None:
    one, other = (CameraSimulator(CAMERA, None, AUTO) for _ in range(2))
    one.photograph()
    for frame in range(3):
        np.testing.assert_array_equal(
            one.capture(DESIRED_POSE, frame), other.capture(DESIRED_POSE, frame)
        )
