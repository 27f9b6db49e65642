"""Car: a base that steers, of bounded curvature and a steering rate, and never turns in place."""

from dataclasses import dataclass
import math

from visual_servo_epipolar.core.bases.base import BaseLimits
from visual_servo_epipolar.core.bases.differential_drive import followed_speed, ramped_speed
from visual_servo_epipolar.core.geometry.motion import saturate, STANDSTILL, Twist

CREEP = 0.01  # at which it waits for its steering: no twist steers standing wheels [m/s]
LAG_WAY = 0.03  # most way until the steering is where it is wanted [m]


@dataclass(frozen=True, slots=True)
class Car:
    """
    Base with a steered axle: its path has a curvature, w = v kappa, and w = 0 where v = 0.

    The curvature is at most ``max_curvature``; the angle of the steered wheels, atan(kappa
    wheelbase), changes by the steering rate. That model alone tells where they are: where the
    path reverses, the base creeps until they are where they have to be. At a standstill they are
    taken for straight, as drivers of steered bases hold them then.
    """

    limits: BaseLimits

    def __post_init__(self) -> None:
        if self.limits.max_curvature == 0.0:
            raise ValueError(
                'max_curvature must be above 0 for base car, got 0; set it to 1 over the radius '
                'of its tightest turn [1/m]'
            )

    @property
    def max_curvature(self) -> float:
        """Largest curvature of its path [1/m]."""
        return self.limits.max_curvature

    def within_speed(self, wanted: Twist, *, ratio: float = 1.0) -> Twist:
        """Return ``wanted`` on a curve that it can drive, at ``ratio`` of its speeds at most."""
        limits = self.limits
        return saturate(
            self._on_curve(wanted),
            max_linear=ratio * limits.max_linear,
            max_angular=ratio * limits.max_angular,
        )

    def within_acceleration(self, wanted: Twist, before: Twist, dt: float) -> Twist:
        """Return what follows ``before`` in ``dt`` [s], as fast as the steering keeps up."""
        limits = self.limits
        angle, reverses = self._steering(before), wanted.linear * before.linear < 0.0
        aim = self._steering(wanted) if wanted.linear and not reverses else angle
        change = limits.steering_rate * dt
        angle += min(max(aim - angle, -change), change)
        lag = abs(aim - angle) / limits.steering_rate
        fastest = max(LAG_WAY / lag, CREEP) if lag > 0.0 else math.inf
        speed = math.copysign(min(abs(wanted.linear), fastest), wanted.linear)
        speed = ramped_speed(speed, before.linear, limits.max_acceleration * dt)
        if reverses and speed * wanted.linear >= 0.0:  # it turns round, and steers before it goes
            speed = math.copysign(min(abs(wanted.linear), CREEP), wanted.linear)
        return self.within_speed(Twist(speed, speed * math.tan(angle) / limits.wheelbase))

    def beyond_dead_band(
        self, wanted: Twist, residual: Twist, *, mode: str
    ) -> tuple[Twist, Twist]:
        """Return what its motor follows of ``wanted``, on the same curve, and the residual."""
        twist, band = self._on_curve(wanted), self.limits.dead_band_linear
        if twist.linear == 0.0 or abs(twist.linear) >= band:
            return twist, STANDSTILL
        speed, rest = followed_speed(twist.linear, residual.linear, band, mode)
        return Twist(speed, speed * twist.angular / twist.linear), Twist(rest, 0.0)

    def _on_curve(self, twist: Twist) -> Twist:
        """Return ``twist`` at its speed, on the nearest curve that can be driven."""
        most = abs(twist.linear) * self.limits.max_curvature
        return Twist(twist.linear, min(max(twist.angular, -most), most))

    def _steering(self, twist: Twist) -> float:
        """Return the angle of the steered wheels [rad], to the left; 0 at a standstill."""
        if twist.linear == 0.0:
            return 0.0
        return math.atan(self.limits.wheelbase * twist.angular / twist.linear)
