"""Base: which velocities a robot's base can follow; servo and phases query it."""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Protocol, TypeAlias

from visual_servo_epipolar.core.arrays import ROUNDING
from visual_servo_epipolar.core.geometry.motion import Twist


@dataclass(frozen=True, slots=True)
class BaseLimits:
    """
    Limits of a base as its settings have them: speeds, accelerations, dead bands [m, rad, s].

    A base speeds up by its accelerations and slows down twice as fast; a speed within its dead
    band does not move it. One that steers has the largest curvature of its path [1/m], its
    wheelbase [m], and how fast its wheels are steered [rad/s]; 0 is one that turns in place.
    """

    max_linear: float
    max_angular: float
    max_acceleration: float
    max_angular_acceleration: float
    dead_band_linear: float
    dead_band_angular: float
    max_curvature: float = 0.0
    wheelbase: float = 0.33
    steering_rate: float = 1.0
    dead_band_mode: str = 'pulse'


class Base(Protocol):
    """A base within its ``limits``; equal bases are equal values."""

    @property
    def limits(self) -> BaseLimits:
        """Limits of speed and acceleration, and dead bands."""

    @property
    def max_curvature(self) -> float:
        """Largest curvature of its path [1/m]; 0 where there is none, and it turns in place."""

    def within_speed(self, wanted: Twist, *, ratio: float = 1.0) -> Twist:
        """Return what it can drive of ``wanted`` at ``ratio`` of its speed, on the same curve."""

    def within_acceleration(self, wanted: Twist, before: Twist, dt: float) -> Twist:
        """Return what it can drive ``dt`` [s] after ``before``, on the way to ``wanted``."""

    def beyond_dead_band(
        self, wanted: Twist, residual: Twist, *, mode: str
    ) -> tuple[Twist, Twist]:
        """
        Return what its motors follow of ``wanted``, and the residual for the next step.

        ``mode`` is what becomes of slower commands: ``raise``, ``zero`` or ``pulse``, which adds
        them up with the ``residual`` of the step before.
        """


BaseFactory: TypeAlias = Callable[[BaseLimits], Base]


def turns_in_place(base: Base) -> bool:
    """Whether a ``base`` turns without driving."""
    return base.max_curvature == 0.0


def capped(base: Base, twist: Twist) -> Twist:
    """Return a ``twist`` that obeyed the speed limits, or is scaled to those lowered since."""
    limits = base.limits
    excess = max(abs(twist.linear) / limits.max_linear, abs(twist.angular) / limits.max_angular)
    return base.within_speed(twist) if excess > 1.0 + ROUNDING else twist
