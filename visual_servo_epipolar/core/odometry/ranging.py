"""
Ranging: the distance to the goal from two bearings and the path between them.

The servo has no odometry, but its commands: between two images the robot went u_1 dt
along its heading, and the heading is measured. The goal is at the origin, and the bearing is psi_0
where the leg began, psi at its end; hence, with r the displacement and p the unit vector of psi,

    (d_0 p_0 + r) x p = 0,    d_0 = -(r x p) / (p_0 x p),    d = (d_0 p_0 + r) . p.

Unlike d_hat of eq. (13) this needs no upper bound to begin with.
"""

from dataclasses import dataclass
import math

from visual_servo_epipolar.core.geometry.epipolar import Bearings

MIN_TURN = 0.04  # of the line of sight, below which the distance is not observable [rad]
LEAST_LEG = 0.02  # way from which a turn of it is not that of a second lens, or of the mount [m]
UNKNOWN_RANGE = 2.0  # largest use of d_hat where the distance was never measured [m]
LOOK_AHEADS = 4.0  # look-ahead distances in the remaining distance, at least
LEAST_LOOK_AHEAD, LEAST_REMEMBERED = 0.25, 0.12  # by two views, by a memory of views [m]
LEAST_TRAVEL = 1e-9  # over which D may show a slope; its square must not vanish [m]
LIKELY = 2.0  # deviations of the slope
MEMORY_LENGTH = 0.5  # travel in which the weight of past slopes falls to 1/e [m]


def look_ahead(distance: float, largest: float, *, least: float = LEAST_LOOK_AHEAD) -> float:
    """Return the look-ahead of line following [m]: a part of ``distance``, within two bounds."""
    if not distance > 0.0:
        return largest
    return min(max(distance / LOOK_AHEADS, least), largest)


@dataclass(frozen=True, slots=True)
class Leg:
    """Leg of the path: bearing ``psi`` at its start [rad], displacement, ``travel`` since [m]."""

    psi: float
    x: float = 0.0
    y: float = 0.0
    travel: float = 0.0

    def extended(self, bearings: Bearings, travel: float) -> 'Leg':
        """Return the leg after ``travel`` [m] along the heading theta = psi - phi."""
        theta = bearings.psi - bearings.phi
        return Leg(
            self.psi,
            self.x + travel * math.cos(theta),
            self.y + travel * math.sin(theta),
            self.travel + travel,
        )

    def distance(self, psi: float, *, min_turn: float = MIN_TURN) -> float | None:
        """Return the distance to the goal [m] at the end, where ``psi`` [rad]; None if unknown."""
        cos_0, sin_0 = math.cos(self.psi), math.sin(self.psi)
        cos_1, sin_1 = math.cos(psi), math.sin(psi)
        sine = cos_0 * sin_1 - sin_0 * cos_1
        if abs(sine) < math.sin(min_turn) or math.hypot(self.x, self.y) < LEAST_LEG:
            return None
        first = -(self.x * sin_1 - self.y * cos_1) / sine
        last = (first * cos_0 + self.x) * cos_1 + (first * sin_0 + self.y) * sin_1
        return last if last > 0.0 else None


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
        if not math.isfinite(change) or abs(travel) < LEAST_TRAVEL:
            return self
        weight = self.weight * math.exp(-abs(travel) / MEMORY_LENGTH) + travel * travel
        value = 0.0 if math.isnan(self.value) else self.value
        return Slope(value + travel * (change - value * travel) / weight, weight)
