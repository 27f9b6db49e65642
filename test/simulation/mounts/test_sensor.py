"""The sensor: noise, gain and blur that depend on seed and frame index alone."""

import numpy as np
import pytest

from visual_servo_epipolar.simulation.sensor import DESIRED_FRAME, Sensor

SIZE = (320, 240)
GREY = np.full((240, 320), 128, dtype=np.uint8)


def sensor(seed: int = 7, **settings: float) -> Sensor:
    return Sensor(SIZE, seed, **settings)


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
