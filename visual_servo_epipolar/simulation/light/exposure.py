"""How bright a sensor takes an image: exposure, fixed or following."""

import math
from typing import NamedTuple

import cv2
import numpy as np

from visual_servo_epipolar.core.arrays import Image
from visual_servo_epipolar.simulation.light.lights import Light, LightSettings

STOP = 12  # steps in which the exposure is set, a factor of two [1]
LEAST = -6 * STOP  # the shortest exposure: 1/64 of the fixed one
HIGHEST = 2 * STOP  # the largest gain: four times the fixed exposure
MOST_STEPS = STOP // 4  # from one image to the next
TARGET_GREY = 100.0  # mean grey that it aims at
HYSTERESIS = 2  # steps off the target at which the exposure begins to follow
SPACING = 4  # of the pixels that are metered [px]
WHITE = 255  # of a window: what is drawn so is GLARE times as bright, however short the exposure
GLARE = 16.0

LUMA = np.array([0.299, 0.587, 0.114])  # share of red, green and blue in grey


class LitView(NamedTuple):
    """What a sensor is to take: the image by its light."""

    image: Image
    light: Light
    factor: float = 1.0  # of the exposure, by which it is set wrong


class Exposure:
    """
    The exposure of a camera, from image to image; 1 is the fixed one.

    An automatic one is set by the image before, by a quarter of a stop at most, and has settled on
    the first image. Up to 1 it is a shorter shutter, and beyond it is gain, which the noise grows
    with. A camera has colours or not; what it takes is grey.
    """

    def __init__(self, settings: LightSettings, *, has_colours: bool = False) -> None:
        self.settings, self.has_colours = settings, has_colours
        self.colours: tuple[float, ...] = (1.0, 1.0, 1.0)  # blue, green, red over grey, at last
        self._steps: int | None = None  # in STOPs, None as long as there was no image

    def begin(self) -> None:
        """Let the exposure settle anew on the next image."""
        self._steps = None

    @property
    def factor(self) -> float:
        """Brightness over that of the fixed exposure."""
        return float(2.0 ** ((self._steps or 0) / STOP))

    def take(self, view: LitView) -> tuple[Image, float]:
        """Return the image, shape (H, W), as it is exposed, and the gain, which noise grows by."""
        glare, grey = view.light.casts_shadows, 1.0
        if self.has_colours:  # how bright the grey image is in which grey things have that colour
            grey = float(LUMA @ np.array(view.light.colour))
            self.colours = tuple((np.array(view.light.colour) / grey)[::-1].tolist())
        light = view.light.level * view.factor * grey
        if self._steps is None:
            self._settle(view.image, light, glare)
        exposure = self.factor if self.settings.exposure == 'auto' else 1.0
        taken = brightened(view.image, light * exposure, glare=glare)
        self._follow(view.image, light, glare)
        return taken, max(exposure, 1.0)

    def _settle(self, image: Image, light: float, glare: bool) -> None:
        self._steps, last = 0, None
        while self._steps != last:
            last = self._steps
            self._follow(image, light, glare)

    def _follow(self, image: Image, light: float, glare: bool) -> None:
        """Set the next exposure by what this one takes."""
        if self._steps is None or self.settings.exposure != 'auto':
            return
        metered = np.ascontiguousarray(image[::SPACING, ::SPACING])
        taken = brightened(metered, light * self.factor, glare=glare)
        off = STOP * math.log2(TARGET_GREY / max(float(cv2.mean(taken)[0]), 1.0))
        if abs(off) < HYSTERESIS:
            return
        step = min(max(round(off), -MOST_STEPS), MOST_STEPS)
        self._steps = min(max(self._steps + step, LEAST), HIGHEST)


def brightened(image: Image, factor: float, *, glare: bool = False) -> Image:
    """Return ``image``, shape (H, W), ``factor`` times as bright, what glares by far more."""
    if factor == 1.0:
        return image
    if not glare:
        return np.asarray(cv2.convertScaleAbs(image, alpha=factor), dtype=np.uint8)
    levels = np.arange(256.0) * factor
    levels[WHITE] *= GLARE
    return np.asarray(cv2.LUT(image, np.rint(np.minimum(levels, 255.0)).astype(np.uint8)))


def toned(image: Image, gamma: float) -> Image:
    """Return ``image``, shape (H, W), with grey to the power of ``gamma``, in units of white."""
    if gamma == 1.0:
        return image
    levels = WHITE * (np.arange(256.0) / WHITE) ** gamma
    return np.asarray(cv2.LUT(image, np.rint(levels).astype(np.uint8)))
