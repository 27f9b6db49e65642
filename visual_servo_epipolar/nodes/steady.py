"""Steady time, which is never set and does not wait: for watchdogs, also in simulated time."""

import math

from rclpy.clock import Clock, ClockType

from visual_servo_epipolar.core.stamps import seconds_between

STEADY = Clock(clock_type=ClockType.STEADY_TIME)
LOOK_PERIOD_S = 0.5  # between looks at publishers and subscribers
PATIENCE_S = 5.0  # before what only advertises, or may wait itself, is missed
SILENT_S = 1.0  # without a message: the source of images or tracks is silent


def now_ns() -> int:
    """Return the steady time [ns]."""
    return int(STEADY.now().nanoseconds)


class Stopwatch:
    """Time since the last start, on the steady clock; unless it ``runs`` it is not started yet."""

    def __init__(self, *, runs: bool = True) -> None:
        self._begin_ns = now_ns() if runs else None

    def start(self) -> None:
        """Count from now on."""
        self._begin_ns = now_ns()

    def stop(self) -> None:
        """Count no longer."""
        self._begin_ns = None

    @property
    def runs(self) -> bool:
        """Whether it counts."""
        return self._begin_ns is not None

    @property
    def seconds(self) -> float:
        """Time since the last start [s], inf where it does not run."""
        return math.inf if self._begin_ns is None else seconds_between(self._begin_ns, now_ns())
