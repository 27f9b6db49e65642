"""
Limiter: turns a wanted velocity into a command that the base can follow.

Every command passes it: each step of the servo, the following of a route and its turns in place.
"""

from dataclasses import dataclass

from visual_servo_epipolar.core.bases.base import Base, capped, within_jerk
from visual_servo_epipolar.core.geometry.motion import STANDSTILL, Twist

MAX_START_STEPS = 1.5  # usual times between two images that a robot speeds up at first


@dataclass(frozen=True, slots=True)
class Limiter:
    """
    Limiter of commands: the ``last`` one, and the ``acceleration`` that led to it [m, rad, s].

    ``residual`` is the part of it that the dead band of the base withheld [m/s, rad/s].
    """

    last: Twist = STANDSTILL
    acceleration: Twist = STANDSTILL
    residual: Twist = STANDSTILL

    def within_limits(
        self, wanted: Twist, dt: float, base: Base, *, ratio: float = 1.0, ramps: bool = True
    ) -> Twist:
        """Return what of ``wanted`` may be driven ``dt`` [s] later, at a ``ratio`` of speed."""
        twist = base.within_speed(wanted, ratio=ratio)
        if not ramps:
            return twist
        twist, last = base.within_acceleration(twist, self.last, dt), self.last
        linear, angular = base.limits.max_jerk, base.limits.max_angular_jerk
        if linear == 0.0 and angular == 0.0:
            return twist
        led = _obeyed(self.acceleration, base)
        twist = Twist(
            within_jerk(twist.linear, last.linear, led.linear, dt, linear),
            within_jerk(twist.angular, last.angular, led.angular, dt, angular),
        )
        lowered = capped(base, last) != last  # a limit of speed, which holds at once
        return capped(base, twist) if lowered else twist

    def after(self, wanted: Twist, dt: float, base: Base) -> 'Limiter':
        """Return the limiter after the command, its ``last``, that a ``wanted`` twist leads to."""
        limited, mode = self.within_limits(wanted, dt, base), base.limits.dead_band_mode
        twist, residual = base.beyond_dead_band(limited, self.residual, mode=mode)
        if dt == 0.0:
            return Limiter(twist, residual=residual)
        change = twist.linear - self.last.linear, twist.angular - self.last.angular
        return Limiter(twist, Twist(change[0] / dt, change[1] / dt), residual)

    def ramp_step(self, dt: float, usual_s: float) -> float:
        """Return the part of ``dt`` [s] that ramps count: from a standstill no pause counts."""
        return min(dt, MAX_START_STEPS * usual_s) if self.last == STANDSTILL else dt


def _obeyed(acceleration: Twist, base: Base) -> Twist:
    """Return the ``acceleration`` that S-curves go on from: none where a lowered limit cut in."""
    limits = base.limits
    linear, angular = 2.0 * limits.max_acceleration, 2.0 * limits.max_angular_acceleration
    return Twist(
        acceleration.linear if abs(acceleration.linear) <= linear else 0.0,
        acceleration.angular if abs(acceleration.angular) <= angular else 0.0,
    )
