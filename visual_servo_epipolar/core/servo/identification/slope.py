"""Slope of D by the way driven, learnt in step 2."""

from dataclasses import dataclass
import math

LEAST_TRAVEL = 1e-9  # over which D may show a slope; its square must not vanish [m]
LIKELY = 2.0  # deviations of the slope
MEMORY_LENGTH = 0.5  # travel in which the weight of past slopes falls to 1/e [m]


@dataclass(frozen=True, slots=True)
class Slope:
    """
    Slope dD/dy by recursive least squares: ``value`` [1/m], D at unit focal length.

    ``weight`` is the sum of squared travels behind it, decayed [m^2].
    """

    value: float = math.nan
    weight: float = 0.0

    def least(self, noise: float) -> float:
        """Return the least slope that D of deviation ``noise`` leaves likely; nan if unknown."""
        if not self.weight > 0.0:
            return math.nan
        return self.value - LIKELY * noise * math.sqrt(2.0 / self.weight)

    def updated(self, change: float, travel: float) -> 'Slope':
        """Return the slope after D changed by ``change`` over ``travel`` [m]."""
        if not math.isfinite(change) or abs(travel) < LEAST_TRAVEL:
            return self
        weight = self.weight * math.exp(-abs(travel) / MEMORY_LENGTH) + travel * travel
        value = 0.0 if math.isnan(self.value) else self.value
        return Slope(value + travel * (change - value * travel) / weight, weight)
