"""Arming: an order to start that no run has begun by yet, and when it lapses."""

import math

from rclpy.clock import Clock

from visual_servo_epipolar.core.stamps import seconds_between


class Arming:
    """
    Order to start: for how long it holds, on the steady ``clock``, and for which photograph.

    A robot that was told to start long ago must not drive off when its photograph, its camera or
    its clock comes at last: somebody may drive it by hand by then.
    """

    def __init__(self, clock: Clock) -> None:
        self._clock = clock
        self._ordered_ns, self._timeout = 0, 0.0
        self._goal: int | None = None

    def order(self, timeout: float, goal: int | None) -> None:
        """Note an order that holds for ``timeout`` [s], for the photograph ``goal`` if known."""
        self._ordered_ns = int(self._clock.now().nanoseconds)
        self._timeout, self._goal = timeout, goal

    @property
    def is_for_good(self) -> bool:
        """Whether it holds until a run begins, as with autostart, and for any photograph."""
        return self._timeout == math.inf

    @property
    def has_expired(self) -> bool:
        """Whether the order is too old to drive by."""
        now_ns = int(self._clock.now().nanoseconds)
        return seconds_between(self._ordered_ns, now_ns) > self._timeout

    def contradicted(self, goal: int | None, *, has_photograph: bool) -> str:
        """Return that tracks are not of the photograph that was there at the order; or ''."""
        if self.is_for_good:
            return ''
        if not has_photograph:
            return 'the photograph is gone'
        self._goal = goal if self._goal is None else self._goal
        return 'the photograph has changed' if goal not in (None, self._goal) else ''
