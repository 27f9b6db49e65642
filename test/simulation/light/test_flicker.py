"""Flicker: what shutter and readout leave of a light that goes with the mains."""

import numpy as np
import pytest

from visual_servo_epipolar.simulation.light.exposure import flicker
from visual_servo_epipolar.simulation.light.lights import LightSettings
from visual_servo_epipolar.simulation.mounts.shutter import INSTANT, Shutter

GREY = np.full((200, 4), 100, np.uint8)


def rows(time: float = 0.0, shutter: float = 0.0, readout: float = 0.0) -> np.ndarray:
    lit = LightSettings(flicker=0.5)
    return flicker(GREY, lit, time, Shutter(readout, shutter)).mean(axis=1)


def test_a_shutter_of_a_whole_period_sees_no_flicker() -> None:
    np.testing.assert_array_equal(rows(shutter=0.01, time=0.003), 100.0)


def test_a_short_shutter_makes_whole_images_brighter_and_darker() -> None:
    light, dark = (rows(shutter=1e-4, time=time) for time in (0.0, 0.005))
    np.testing.assert_array_equal(light, 150.0)
    np.testing.assert_array_equal(dark, 50.0)


def test_an_exposure_that_shortens_the_shutter_brings_the_flicker() -> None:
    assert abs(rows(shutter=0.0025)[0] - 100.0) > 10.0


def test_rows_that_are_read_one_by_one_show_bands() -> None:
    bands = rows(shutter=1e-4, readout=0.02)
    spectrum = np.abs(np.fft.rfft(bands - bands.mean()))
    assert spectrum.argmax() == 2  # of 100 Hz in 20 ms
    assert bands.max() - bands.min() == pytest.approx(100.0, abs=2.0)


def test_no_flicker_leaves_the_image_alone() -> None:
    assert flicker(GREY, LightSettings(), 0.0, INSTANT) is GREY
