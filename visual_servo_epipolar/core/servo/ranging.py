"""
Distance to the goal from two bearings and the way between them.

The servo has no odometry, but it knows what it commanded: between two images the robot went
u_1 dt along its heading, and the heading is measured. From where the leg began the goal is seen
under psi_0, from its end under psi; the goal is at the origin, hence

    (d_0 p_0 + way) x p = 0,    d_0 = -(way x p) / (p_0 x p),

with p the unit vector of psi. Unlike d_hat of eq. (13) this needs no upper bound to begin with.
"""

from dataclasses import dataclass, replace
import math

from visual_servo_epipolar.core.geometry.epipolar import Bearings

MIN_TURN = 0.04  # of the line of sight, before it says anything about the distance [rad]

UNKNOWN_RANGE = 2.0  # of d_hat at most, where the distance was never measured [m]
LOOK_AHEADS, LEAST_LOOK_AHEAD = 4.0, 0.25  # in the way that is left, and [m]


def look_ahead(distance: float, largest: float) -> float:
    """Return L of line following [m]: some of them fit into the ``distance``, if it is known."""
    if not distance > 0.0:
        return largest
    return min(max(distance / LOOK_AHEADS, LEAST_LOOK_AHEAD), largest)


@dataclass(frozen=True, slots=True)
class Leg:
    """A leg of the way: bearing psi [rad] where it began, and the way since [m]."""

    psi: float
    x: float = 0.0
    y: float = 0.0

    def extended(self, bearings: Bearings, way: float) -> 'Leg':
        """Return the leg after ``way`` [m] in the direction that ``bearings`` imply."""
        theta = bearings.psi - bearings.phi
        return replace(self, x=self.x + way * math.cos(theta), y=self.y + way * math.sin(theta))

    def distance(self, psi: float, *, min_turn: float = MIN_TURN) -> float | None:
        """Return the distance now to the goal, seen under ``psi``; None before it shows."""
        cos_0, sin_0, cos_1, sin_1 = (
            math.cos(self.psi),
            math.sin(self.psi),
            math.cos(psi),
            math.sin(psi),
        )
        turn = cos_0 * sin_1 - sin_0 * cos_1
        if abs(turn) < math.sin(min_turn):
            return None
        first = -(self.x * sin_1 - self.y * cos_1) / turn
        now = (first * cos_0 + self.x) * cos_1 + (first * sin_0 + self.y) * sin_1
        return now if now > 0.0 else None
