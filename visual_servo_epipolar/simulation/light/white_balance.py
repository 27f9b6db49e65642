"""White balance: gains of a camera's colours, fixed or as they follow the light."""

from typing import TypeAlias

import numpy as np

from visual_servo_epipolar.core.arrays import FloatArray

Colour: TypeAlias = tuple[float, float, float]  # red, green, blue
LUMA = np.array([0.299, 0.587, 0.114])  # share of red, green and blue in grey
LARGEST, STEP = 2.5, 0.04  # gain of a colour over green, either way; its change an image


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
        self._gains = np.clip(light[1] / light, 1.0 / LARGEST, LARGEST)

    def follow(self, colour: Colour) -> None:
        """Move the gains towards those of that ``colour``, by a step."""
        before = self._gains
        self.settle(colour)
        self._gains = before * np.clip(self._gains / before, 1.0 / (1.0 + STEP), 1.0 + STEP)
