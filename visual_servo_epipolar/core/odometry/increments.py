"""Increments: the motion of the base between two images, with its covariance."""

from dataclasses import dataclass
import math
from typing import NamedTuple

import numpy as np

from visual_servo_epipolar.core.arrays import FloatArray


class MotionNoise(NamedTuple):
    """
    What a motion is uncertain by: shares of its way and of its turn.

    It goes on for views after it, ``fading`` from one to the next, where it comes late. ``noise``
    is the deviation of a random walk, after a metre and after a radian.
    """

    way: float
    turn: float
    fading: float = 0.0
    noise: float = 0.0


# A base may drive or turn otherwise than commanded, and obeys late; wheels slip.
COMMANDED, MEASURED = MotionNoise(0.3, 0.5, fading=0.6), MotionNoise(0.05, 0.05, noise=0.0075)


@dataclass(frozen=True, slots=True)
class Motion:
    """Motion between two views, ahead [m], left [rad]: commanded, or ``measured`` by wheels."""

    way: float = 0.0
    turn: float = 0.0
    measured: bool = False

    def __add__(self, other: 'Motion') -> 'Motion':
        """Return the ways and the turns of both together."""
        return Motion(self.way + other.way, self.turn + other.turn)

    @property
    def chord(self) -> FloatArray:
        """Where it leads, (2,): right and ahead in axes of before [m]."""
        return self.way * np.array([-math.sin(0.5 * self.turn), math.cos(0.5 * self.turn)])

    @property
    def noise(self) -> MotionNoise:
        """What it is uncertain by."""
        return MEASURED if self.measured else COMMANDED


class OdometryIncrement(NamedTuple):
    """What was driven between two views, ``commanded`` and by ``wheels``; whether these count."""

    commanded: Motion
    wheels: Motion
    trusted: bool = False

    @property
    def motion(self) -> Motion:
        """That which counts."""
        return self.wheels if self.trusted else self.commanded

    @property
    def other(self) -> Motion:
        """That which does not."""
        return self.commanded if self.trusted else self.wheels
