"""Rates of decay: a straight line through the logarithm."""

from dataclasses import dataclass
import math

import numpy as np

from visual_servo_epipolar.core.arrays import FloatArray


@dataclass(frozen=True, slots=True)
class Decay:
    """
    value(t) ~ initial exp(-rate t) on ``start`` <= t <= ``end`` [s]; rate in 1/s.

    ``misfit`` is the standard deviation of the logarithm about the line.
    """

    rate: float
    initial: float
    misfit: float
    start: float
    end: float

    def at(self, time: FloatArray) -> FloatArray:
        """Return the fitted values at ``time`` [s], shape (N,)."""
        return np.asarray(self.initial * np.exp(-self.rate * time))


def decay(time: FloatArray, value: FloatArray) -> Decay:
    """
    Fit an exponential to |value|, shape (N,), at ``time`` [s] by least squares in the logarithm.

    Raises ValueError with fewer than three values that differ from zero.
    """
    good = np.isfinite(value) & (value != 0.0)
    if int(good.sum()) < 3:
        raise ValueError(
            f'a decay needs three values that are not zero, got {int(good.sum())}; '
            'fit a longer stretch'
        )
    time, logarithm = time[good], np.log(np.abs(value[good]))
    slope, offset = np.polyfit(time, logarithm, 1)
    misfit = float(np.std(logarithm - (slope * time + offset)))
    return Decay(-float(slope), math.exp(offset), misfit, float(time[0]), float(time[-1]))
