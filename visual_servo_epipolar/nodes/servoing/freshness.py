"""Freshness: how long ago the last new tracks came, on a clock that nobody sets."""

from rclpy.clock import Clock, ClockType

from visual_servo_epipolar.core.stamps import seconds_between


class Freshness:
    """Time since the last new tracks, on the steady ``clock``; none count as just come."""

    def __init__(self) -> None:
        self.clock = Clock(clock_type=ClockType.STEADY_TIME)
        self._fresh_ns: int | None = None

    def renew(self) -> None:
        """Note that new tracks have come."""
        self._fresh_ns = self.clock.now().nanoseconds

    @property
    def age(self) -> float:
        """Time since the last new tracks [s]."""
        if self._fresh_ns is None:
            return 0.0
        return seconds_between(self._fresh_ns, self.clock.now().nanoseconds)
