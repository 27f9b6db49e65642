"""Differential drive: two wheels, any speed and turn at once, and turns in place."""

from dataclasses import dataclass
import math

from visual_servo_epipolar.core.bases.base import BaseLimits, capped
from visual_servo_epipolar.core.geometry.motion import saturate, Twist


@dataclass(frozen=True, slots=True)
class DifferentialDrive:
    """Base of two driven wheels: each velocity has its own limit, ramp and dead band."""

    limits: BaseLimits
    max_curvature: float = 0.0

    def within_speed(self, wanted: Twist, *, ratio: float = 1.0) -> Twist:
        """Return ``wanted`` at ``ratio`` of the speed limits at most, on the same curve."""
        limits = self.limits
        return saturate(
            wanted,
            max_linear=ratio * limits.max_linear,
            max_angular=ratio * limits.max_angular,
        )

    def within_acceleration(self, wanted: Twist, before: Twist, dt: float) -> Twist:
        """Return what follows ``before`` in ``dt`` [s]; a speed limit lowered by then holds."""
        limits = self.limits
        linear, angular = limits.max_acceleration * dt, limits.max_angular_acceleration * dt
        twist = Twist(
            ramped_speed(wanted.linear, before.linear, linear),
            ramped_speed(wanted.angular, before.angular, angular),
        )
        return capped(self, twist)

    def beyond_dead_band(
        self, wanted: Twist, residual: Twist, *, mode: str
    ) -> tuple[Twist, Twist]:
        """Return what the motors follow of ``wanted``, and the residual of ``mode`` pulse."""
        linear, angular = self.limits.dead_band_linear, self.limits.dead_band_angular
        first = followed_speed(wanted.linear, residual.linear, linear, mode)
        second = followed_speed(wanted.angular, residual.angular, angular, mode)
        return Twist(first[0], second[0]), Twist(first[1], second[1])


def ramped_speed(wanted: float, before: float, change: float) -> float:
    """Return what follows the speed ``before`` towards ``wanted``; ``change`` is a speed-up."""
    slower = abs(wanted) < abs(before) or wanted * before < 0.0
    limit = 2.0 * change if slower else change
    if wanted * before < 0.0:  # once it stands, it speeds up the other way
        limit = min(limit, change + 0.5 * abs(before))
    return before + min(max(wanted - before, -limit), limit)


def followed_speed(
    wanted: float, residual: float, threshold: float, mode: str
) -> tuple[float, float]:
    """
    Return a speed that is 0 or beyond the ``threshold`` of motors, and the new ``residual``.

    ``mode`` raise lifts what is smaller to the threshold, as the paper did (section VIII), zero
    drops it; a speed of exactly zero stays zero. ``pulse`` is a first-order sigma-delta
    modulation: what is below adds up, frame by frame, until it is a whole pulse: half of one would
    ask for a pulse back next. Lifting every small command instead turns a proportional law into a
    switch, and dropping it into one that never gets there.
    """
    if wanted == 0.0 or abs(wanted) >= threshold:
        return wanted, 0.0
    if mode != 'pulse':
        return (math.copysign(threshold, wanted) if mode == 'raise' else 0.0), 0.0
    # More than a pulse is left of a move that was given up.
    residual = wanted + (residual if abs(residual) < threshold else 0.0)
    speed = math.copysign(threshold, residual) if abs(residual) >= threshold else 0.0
    return speed, residual - speed
