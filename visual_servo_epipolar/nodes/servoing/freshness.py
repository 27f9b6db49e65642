"""Freshness: how long tracks and trust have been missing, on a clock that is never set."""

from rclpy.clock import Clock, ClockType

from visual_servo_epipolar.core.laws.phase import Phase
from visual_servo_epipolar.core.stamps import seconds_between

WATCH_PERIOD_S, IDLE_PERIOD_S = 0.05, 1.0  # of looks at what drives, and at what stands


class Freshness:
    """
    Time since the last new tracks and since the servo holds, on the steady ``clock``.

    ``node_clock`` is that of the node, simulated or not.

    A simulated clock stands still where its publisher dies, and the wall clock is set at times.
    """

    def __init__(self, node_clock: Clock) -> None:
        self.clock, self._node_clock = Clock(clock_type=ClockType.STEADY_TIME), node_clock
        self._time_ns, self._time_since_ns = -1, 0  # of the node, and since when it is that
        self._begin_ns = self._now_ns()
        self._stepped_ns = self._begin_ns
        self._heard_ns = self._begin_ns
        self._fresh_ns: int | None = None
        self._holding_ns: int | None = None

    def hear(self) -> None:
        """Note that tracks have come, be they usable or not."""
        self._heard_ns = self._now_ns()

    def renew(self) -> None:
        """Note that new tracks have come."""
        self._fresh_ns = self._now_ns()

    def step(self) -> None:
        """Note that tracks have led to a step."""
        self._stepped_ns = self._now_ns()

    def follow(self, phase: Phase) -> None:
        """Note the phase that the servo is in."""
        if phase is not Phase.HOLDING:
            self._holding_ns = None
        elif self._holding_ns is None:
            self._holding_ns = self._now_ns()

    @property
    def age(self) -> float:
        """Time since the last new tracks [s], or since the beginning."""
        return self._since(self._begin_ns if self._fresh_ns is None else self._fresh_ns)

    @property
    def quiet(self) -> float:
        """Time since any tracks came [s], or since the beginning."""
        return self._since(self._heard_ns)

    @property
    def idle(self) -> float:
        """Time since the last step [s], or since the beginning."""
        return self._since(self._stepped_ns)

    @property
    def held(self) -> float:
        """Time since the servo began to hold [s], 0 where it does not."""
        return 0.0 if self._holding_ns is None else self._since(self._holding_ns)

    def clock_stands_still(self) -> float:
        """Look at the clock of the node, and return for how long it has stood still [s]."""
        time_ns, now_ns = int(self._node_clock.now().nanoseconds), self._now_ns()
        if time_ns != self._time_ns:
            self._time_ns, self._time_since_ns = time_ns, now_ns
        return seconds_between(self._time_since_ns, now_ns)

    def _since(self, moment_ns: int) -> float:
        return seconds_between(moment_ns, self._now_ns())

    def _now_ns(self) -> int:
        return int(self.clock.now().nanoseconds)
