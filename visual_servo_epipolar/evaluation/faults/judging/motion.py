"""Motion: whether a base moves, how long it takes to stand."""

from visual_servo_epipolar.core.geometry.motion import Twist
from visual_servo_epipolar.evaluation.faults.judging.record import Bounds

MOVING_M_S, MOVING_RAD_S = 1e-3, 1e-3


def moving(twist: Twist) -> bool:
    """Return whether a base of this velocity moves."""
    return abs(twist.linear) > MOVING_M_S or abs(twist.angular) > MOVING_RAD_S


def braking_s(twist: Twist, bounds: Bounds) -> float:
    """Return the time in which the base comes to rest from ``twist`` [s]."""
    return bounds.delay_s + max(
        abs(twist.linear) / bounds.base_deceleration,
        abs(twist.angular) / bounds.base_angular_acceleration,
    )


def speed(twist: Twist) -> str:
    """Return a velocity in words."""
    return f'{twist.linear:.2f} m/s, {twist.angular:.2f} rad/s'
