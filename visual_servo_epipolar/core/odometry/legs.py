"""Legs of the path by commands and headings, the slope of D over a way, look-aheads."""

from dataclasses import dataclass
import math

from visual_servo_epipolar.core.arrays import ROUNDING
from visual_servo_epipolar.core.geometry.epipolar import Bearings

UNKNOWN_RANGE = 2.0  # largest use of d_hat where the distance was never measured [m]
LOOK_AHEADS = 4.0  # look-ahead distances in the remaining distance, at least
LEAST_LOOK_AHEAD, LEAST_REMEMBERED = 0.25, 0.12  # by two views, by a memory of views [m]
LIKELY = 2.0  # deviations by which a slope, or a way, may well be off
MEMORY_LENGTH = 0.5  # travel in which the weight of past slopes falls to 1/e [m]


def look_ahead(distance: float, largest: float, *, least: float = LEAST_LOOK_AHEAD) -> float:
    """Return the look-ahead of line following [m]: a part of ``distance``, within two bounds."""
    if not distance > 0.0:
        return largest
    return min(max(distance / LOOK_AHEADS, least), largest)


@dataclass(frozen=True, slots=True)
class Leg:
    """Leg of the path: displacement from its start in axes of the goal, and ``travel`` [m]."""

    x: float = 0.0
    y: float = 0.0
    travel: float = 0.0

    def extended(self, bearings: Bearings, travel: float) -> 'Leg':
        """Return the leg after ``travel`` [m] along the heading theta = psi - phi."""
        theta = bearings.psi - bearings.phi
        return Leg(
            self.x + travel * math.cos(theta),
            self.y + travel * math.sin(theta),
            self.travel + travel,
        )


@dataclass(frozen=True, slots=True)
class Slope:
    """Slope dD/dy [1/m] by recursive least squares; ``weight``: squared travel, decayed [m^2]."""

    value: float = math.nan
    weight: float = 0.0

    def least(self, noise: float) -> float:
        """Return the least slope that D of deviation ``noise`` leaves likely; nan if unknown."""
        if not self.weight > 0.0:
            return math.nan
        return self.value - LIKELY * noise * math.sqrt(2.0 / self.weight)

    def updated(self, change: float, travel: float) -> 'Slope':
        """Return the slope after D changed by ``change`` over ``travel`` [m]."""
        if not math.isfinite(change) or abs(travel) < ROUNDING:
            return self
        weight = self.weight * math.exp(-abs(travel) / MEMORY_LENGTH) + travel * travel
        value = 0.0 if math.isnan(self.value) else self.value
        return Slope(value + travel * (change - value * travel) / weight, weight)
