"""Hooks into rclpy: while they hold, messages, clocks and logs of all nodes go to a wire."""

from collections.abc import Iterator
from contextlib import contextmanager, ExitStack
from typing import Any

from rclpy.clock import Clock, ClockType
from rclpy.impl.rcutils_logger import RcutilsLogger
from rclpy.publisher import Publisher
from rclpy.time import Time

from visual_servo_epipolar.evaluation.live.wire import Wire


@contextmanager
def hook_rclpy(wire: Wire) -> Iterator[None]:
    """
    Let ``wire`` carry what nodes of this process publish and log, and tell them the time.

    Entities of rclpy stay real: names, types and QoS are theirs. Classes are hooked, not objects,
    so that what a node publishes in its constructor is carried as well, and what a managed
    publisher withholds is not. A clock that follows /clock is left to rclpy.
    """
    real_now = Clock.now

    def now(clock: Clock) -> Time:
        if clock.clock_type is ClockType.STEADY_TIME:
            return Time(nanoseconds=wire.now_ns, clock_type=clock.clock_type)
        if getattr(clock, 'ros_time_is_active', False):
            return real_now(clock)
        return Time(nanoseconds=wire.wall_ns, clock_type=clock.clock_type)

    def publish(publisher: Publisher, message: Any) -> None:
        wire.publish(publisher, message)

    def log(logger: RcutilsLogger, message: str, severity: int, **_: Any) -> bool:
        wire.log(str(logger.name), int(severity), str(message))
        return True

    with ExitStack() as stack:
        for kind, name, function in (
            (Clock, 'now', now),
            (Publisher, 'publish', publish),
            (Publisher, 'wait_for_all_acked', lambda publisher, timeout=None: True),
            (RcutilsLogger, 'log', log),
        ):
            stack.callback(setattr, kind, name, getattr(kind, name))
            setattr(kind, name, function)
        yield
