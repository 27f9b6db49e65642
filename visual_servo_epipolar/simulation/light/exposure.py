"""How bright a sensor takes an image: exposure and white balance, fixed or following; flicker."""

import math
from typing import NamedTuple, TypeAlias

import cv2
import numpy as np

from visual_servo_epipolar.core.arrays import FloatArray, Image
from visual_servo_epipolar.simulation.light.lights import Light, LightSettings
from visual_servo_epipolar.simulation.mounts.shutter import INSTANT, Shutter

STOP = 12  # steps in which the exposure is set, a factor of two [1]
LEAST = -6 * STOP  # the shortest exposure: 1/64 of the fixed one
HYSTERESIS = 2  # steps off the target at which the exposure begins to follow
SPACING = 4  # of the pixels that are metered [px]
WHITE = 255  # of a window: what is drawn so is GLARE times as bright, however short the exposure
GLARE = 16.0

Colour: TypeAlias = tuple[float, float, float]  # red, green, blue
LUMA = np.array([0.299, 0.587, 0.114])  # share of red, green and blue in grey
LARGEST_GAIN, GAIN_STEP = 2.5, 0.04  # of a colour over green, either way; its change an image


class WhiteBalance:
    """
    Gains of red, green and blue, those of white light at first.

    Where they follow, they make what is grey as red and as blue as green, by a step an image.
    """

    def __init__(self) -> None:
        self._gains, self._taken = np.ones(3), np.ones(3)

    @property
    def colours(self) -> FloatArray:
        """Blue, green and red of the image that was taken last, over its grey, shape (3,)."""
        return np.asarray((self._taken / (LUMA @ self._taken))[::-1])

    def take(self, colour: Colour) -> float:
        """Return how bright the grey image is in which grey things have that ``colour``."""
        self._taken = self._gains * np.array(colour)
        return float(LUMA @ self._taken)

    def settle(self, colour: Colour) -> None:
        """Let the gains be those of that ``colour``, within their limits."""
        light = np.array(colour)
        self._gains = np.clip(light[1] / light, 1.0 / LARGEST_GAIN, LARGEST_GAIN)

    def follow(self, colour: Colour) -> None:
        """Move the gains towards those of that ``colour``, by a step."""
        before = self._gains
        self.settle(colour)
        self._gains = before * np.clip(
            self._gains / before, 1.0 / (1.0 + GAIN_STEP), 1.0 + GAIN_STEP
        )


class LitView(NamedTuple):
    """What a sensor is to take: the image by its light, and when [s]."""

    image: Image
    light: Light
    time: float
    factor: float = 1.0  # of the exposure, by which it is set wrong


class Exposure:
    """
    The exposure of a camera, from image to image; 1 is the fixed one.

    An automatic one is set by the image before, by a step at most, and has settled on the first
    image. Up to 1 it is a shorter shutter, and beyond it is gain, which the noise grows with. A
    camera has colours or not; what it takes is grey.
    """

    def __init__(
        self, settings: LightSettings, shutter: Shutter = INSTANT, *, has_colours: bool = False
    ) -> None:
        self.settings, self.shutter = settings, shutter
        self.balance = WhiteBalance() if has_colours else None
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
        is_first, glare = self._steps is None, view.light.casts_shadows
        light = view.light.level * view.factor * self._balanced(view.light, settle=is_first)
        if is_first:
            self._settle(view.image, light, glare)
        exposure = self.factor if self.settings.exposure == 'auto' else 1.0
        taken = brightened(view.image, light * exposure, glare=glare)
        self._follow(view.image, light, glare)
        open_s = self.shutter.exposure * min(exposure, 1.0)
        shutter = self.shutter._replace(exposure=open_s)
        taken = flicker(taken, self.settings, view.time, shutter)
        return taken, max(exposure, 1.0)

    def _balanced(self, light: Light, *, settle: bool) -> float:
        """Return how bright what is grey is by the gains of the colours, which then follow."""
        if self.balance is None:
            return 1.0
        follows = self.settings.white_balance == 'auto'
        if follows and settle:
            self.balance.settle(light.colour)
        grey = self.balance.take(light.colour)
        if follows:
            self.balance.follow(light.colour)
        return grey

    def _settle(self, image: Image, light: float, glare: bool) -> None:
        self._steps, last = 0, None
        while self._steps != last:
            last = self._steps
            self._follow(image, light, glare)

    def _follow(self, image: Image, light: float, glare: bool) -> None:
        """Set the next exposure by what this one takes."""
        settings = self.settings
        if self._steps is None or settings.exposure != 'auto':
            return
        metered = np.ascontiguousarray(image[::SPACING, ::SPACING])
        taken = brightened(metered, light * self.factor, glare=glare)
        off = STOP * math.log2(settings.target_grey / max(float(cv2.mean(taken)[0]), 1.0))
        if abs(off) < HYSTERESIS:
            return
        most = max(1, round(STOP * settings.exposure_step))
        step = min(max(round(off), -most), most)
        highest = math.floor(STOP * math.log2(settings.max_gain))
        self._steps = min(max(self._steps + step, LEAST), highest)


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


def flicker(image: Image, settings: LightSettings, time: float, shutter: Shutter) -> Image:
    """
    Return ``image``, shape (H, W), whose first row opens at ``time`` [s], as the light flickers.

    A ``shutter`` open for a whole period sees nothing of it; a shorter one takes what it meets:
    all rows alike, or bands where they are read out one by one.
    """
    depth, rate, (readout, exposure, *_) = settings.flicker, settings.flicker_rate, shutter
    if depth == 0.0:
        return image
    seen = depth * np.sinc(rate * exposure)  # the mean of a wave over the exposure
    rows = len(image) if readout else 1
    middle = time + 0.5 * exposure + readout * np.arange(rows) / rows
    factors = (1.0 + seen * np.cos(2.0 * math.pi * rate * middle))[:, None]
    if rows == 1:
        return np.asarray(cv2.convertScaleAbs(image, alpha=float(factors[0, 0])), np.uint8)
    bands = np.broadcast_to(factors.astype(np.float32), image.shape)
    return np.asarray(cv2.multiply(image, bands, dtype=cv2.CV_8U), dtype=np.uint8)
