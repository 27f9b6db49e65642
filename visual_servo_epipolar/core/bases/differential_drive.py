"""Differential drive: two wheels, any speed and turn at once, and turns in place."""

from dataclasses import dataclass
import math

from visual_servo_epipolar.core.bases.base import BaseLimits, capped
from visual_servo_epipolar.core.geometry.motion import saturate, STANDSTILL, Twist


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
        twist = ramp(
            wanted,
            before,
            dt,
            linear=limits.max_acceleration,
            angular=limits.max_angular_acceleration,
        )
        return capped(self, twist)

    def beyond_dead_band(
        self, wanted: Twist, residual: Twist, *, mode: str
    ) -> tuple[Twist, Twist]:
        """Return what the motors follow of ``wanted``, and the residual of ``mode`` pulse."""
        limits = self.limits
        bands = {'linear': limits.dead_band_linear, 'angular': limits.dead_band_angular}
        if mode == 'pulse':
            return modulate_pulses(wanted, residual, **bands)
        return clear_dead_band(wanted, lift=mode == 'raise', **bands), STANDSTILL


def ramp(wanted: Twist, before: Twist, dt: float, *, linear: float, angular: float) -> Twist:
    """Limit the change from ``before``, speeding up half as fast as slowing down."""
    return Twist(
        ramped_speed(wanted.linear, before.linear, linear * dt),
        ramped_speed(wanted.angular, before.angular, angular * dt),
    )


def ramped_speed(wanted: float, before: float, change: float) -> float:
    """Return what follows the speed ``before`` towards ``wanted``; ``change`` is a speed-up."""
    slower = abs(wanted) < abs(before) or wanted * before < 0.0
    limit = 2.0 * change if slower else change
    if wanted * before < 0.0:  # once it stands, it speeds up the other way
        limit = min(limit, change + 0.5 * abs(before))
    return before + min(max(wanted - before, -limit), limit)


def clear_dead_band(twist: Twist, *, linear: float, angular: float, lift: bool) -> Twist:
    """
    Return velocities that the motors can follow, which stand still below a threshold.

    ``lift`` raises what is smaller to the threshold, as the paper did (section VIII), else it is
    dropped; a velocity of exactly zero stays zero. Thresholds in m/s and rad/s.
    """
    return Twist(
        _beyond(twist.linear, linear, lift),
        _beyond(twist.angular, angular, lift),
    )


def _beyond(value: float, threshold: float, lift: bool) -> float:
    if value == 0.0 or abs(value) >= threshold:
        return value
    return math.copysign(threshold, value) if lift else 0.0


def modulate_pulses(
    wanted: Twist, residual: Twist, *, linear: float, angular: float
) -> tuple[Twist, Twist]:
    """
    Return velocities beyond the thresholds whose average is the wanted one, and the new residual.

    First-order sigma-delta modulation: what is below a threshold [m/s, rad/s] adds up, frame by
    frame, until it is a whole pulse: half of one would ask for a pulse back next. Lifting every
    small command instead turns a proportional law into a switch, and dropping it into one that
    never gets there.
    """
    first = pulse(wanted.linear, residual.linear, linear)
    second = pulse(wanted.angular, residual.angular, angular)
    return Twist(first[0], second[0]), Twist(first[1], second[1])


def pulse(wanted: float, residual: float, threshold: float) -> tuple[float, float]:
    """Return a speed that is 0 or beyond the ``threshold``, and the new ``residual``."""
    if wanted == 0.0 or abs(wanted) >= threshold:
        return wanted, 0.0
    # More than a pulse is left of a move that was given up.
    residual = wanted + (residual if abs(residual) < threshold else 0.0)
    speed = math.copysign(threshold, residual) if abs(residual) >= threshold else 0.0
    return speed, residual - speed
