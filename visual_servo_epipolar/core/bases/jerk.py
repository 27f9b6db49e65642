"""Jerk: how fast accelerations change, so that what stands on the base does not nod."""

import math

from visual_servo_epipolar.core.geometry.motion import Twist


def within_jerk(
    wanted: Twist,
    before: Twist,
    acceleration: Twist,
    dt: float,
    *,
    linear: float,
    angular: float,
) -> Twist:
    """
    Return what follows ``before`` after ``dt`` [s] on the way to ``wanted``: S-curves.

    ``acceleration`` led to ``before`` [m/s^2, rad/s^2]. The jerk stays within ``linear`` [m/s^3]
    and ``angular`` [rad/s^3], 0 for no limit; limits of acceleration are those of ``wanted``.
    """
    return Twist(
        _followed(wanted.linear, before.linear, acceleration.linear, dt, linear),
        _followed(wanted.angular, before.angular, acceleration.angular, dt, angular),
    )


def _followed(wanted: float, before: float, acceleration: float, dt: float, jerk: float) -> float:
    if jerk == 0.0 or dt == 0.0:
        return wanted
    change = wanted - before
    # The acceleration from which jerk ends at zero just where the change is done.
    late = 0.5 * jerk * dt
    most = math.sqrt(late * late + 2.0 * jerk * abs(change)) - late
    aim = math.copysign(min(abs(change) / dt, most), change)
    step = min(max(aim - acceleration, -jerk * dt), jerk * dt)
    return before + (acceleration + step) * dt
