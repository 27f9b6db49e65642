"""Exposure: how bright a sensor takes an image, fixed or as it follows the light."""

import math

import cv2
import numpy as np

from visual_servo_epipolar.core.arrays import Image
from visual_servo_epipolar.simulation.light.settings import LightSettings

STOP = 12  # steps in which the exposure is set, a factor of two [1]
LEAST = -6 * STOP  # the shortest exposure: 1/64 of the fixed one
HYSTERESIS = 2  # steps off the target at which the exposure begins to follow
SPACING = 4  # of the pixels that are metered [px]


class Exposure:
    """
    The exposure of a camera, from image to image; 1 is the fixed one.

    An automatic one is set by the image before, by a step at most, and has settled on the first
    image. Up to 1 it is a shorter shutter, and beyond it is gain, which the noise grows with.
    """

    def __init__(self, settings: LightSettings) -> None:
        self._settings = settings
        self._steps: int | None = None  # in STOPs, None as long as there was no image

    def begin(self) -> None:
        """Let the exposure settle anew on the next image."""
        self._steps = None

    @property
    def factor(self) -> float:
        """Brightness over that of the fixed exposure."""
        return float(2.0 ** ((self._steps or 0) / STOP))

    def take(self, image: Image, light: float) -> tuple[Image, float]:
        """
        Return ``image``, shape (H, W), as it is exposed, and the gain, which noise grows with.

        The light is ``light`` times that in which it was drawn.
        """
        if self._settings.exposure == 'fixed':
            return brightened(image, light), 1.0
        metered = np.ascontiguousarray(image[::SPACING, ::SPACING])
        if self._steps is None:
            self._settle(metered, light)
        taken, gain = brightened(image, light * self.factor), max(self.factor, 1.0)
        self._follow(metered, light)
        return taken, gain

    def _settle(self, metered: Image, light: float) -> None:
        self._steps, last = 0, None
        while self._steps != last:
            last = self._steps
            self._follow(metered, light)

    def _follow(self, metered: Image, light: float) -> None:
        """Set the next exposure by what this one takes."""
        assert self._steps is not None
        settings = self._settings
        grey = max(float(cv2.mean(brightened(metered, light * self.factor))[0]), 1.0)
        off = STOP * math.log2(settings.target_grey / grey)
        if abs(off) < HYSTERESIS:
            return
        most = max(1, round(STOP * settings.exposure_step))
        step = min(max(round(off), -most), most)
        highest = math.floor(STOP * math.log2(settings.max_gain))
        self._steps = min(max(self._steps + step, LEAST), highest)


def brightened(image: Image, factor: float) -> Image:
    """Return ``image``, shape (H, W), ``factor`` times as bright."""
    if factor == 1.0:
        return image
    return np.asarray(cv2.convertScaleAbs(image, alpha=factor), dtype=np.uint8)
