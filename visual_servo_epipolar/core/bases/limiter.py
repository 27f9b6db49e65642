"""
Limiter: turns a wanted velocity into a command that the base can follow.

Every command passes it: each step of the servo, the following of a route and its turns in place.
"""

from dataclasses import dataclass

from visual_servo_epipolar.core.bases.base import Base
from visual_servo_epipolar.core.geometry.motion import STANDSTILL, Twist

MAX_START_STEPS = 1.5  # usual times between two images that a robot speeds up at first


@dataclass(frozen=True, slots=True)
class Limiter:
    """Limiter: the ``last`` command, and the ``residual`` that the base's dead band withheld."""

    last: Twist = STANDSTILL
    residual: Twist = STANDSTILL

    def within_limits(
        self, wanted: Twist, dt: float, base: Base, *, ratio: float = 1.0, ramps: bool = True
    ) -> Twist:
        """Return what of ``wanted`` may be driven ``dt`` [s] later, at a ``ratio`` of speed."""
        twist = base.within_speed(wanted, ratio=ratio)
        return base.within_acceleration(twist, self.last, dt) if ramps else twist

    def after(self, wanted: Twist, dt: float, base: Base) -> 'Limiter':
        """Return the limiter after the command, its ``last``, that a ``wanted`` twist leads to."""
        limited, mode = self.within_limits(wanted, dt, base), base.limits.dead_band_mode
        return Limiter(*base.beyond_dead_band(limited, self.residual, mode=mode))

    def ramp_step(self, dt: float, usual_s: float) -> float:
        """Return the part of ``dt`` [s] that ramps count: from a standstill no pause counts."""
        return min(dt, MAX_START_STEPS * usual_s) if self.last == STANDSTILL else dt
