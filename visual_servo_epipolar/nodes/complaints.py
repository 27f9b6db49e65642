"""Complaints of a node: each is said at once, and again when it has lasted."""

import re

from rclpy.clock import Clock, ClockType
from rclpy.node import Node

from visual_servo_epipolar.core.stamps import seconds_between

NUMBER = re.compile(r'[-+]?(?:\d[\d.]*(?:e[-+]?\d+)?|\b(?:nan|inf)\b)')
MOST = 100  # kinds of complaints that are remembered: texts of others may be in them


class Complaints:
    """
    Complaints of ``node``, as warnings, each at most once in ``period_s`` [s].

    Alike are those that differ in their numbers alone. The throttle of rclpy knows lines of code:
    one complaint would hide every other that comes from the same line.
    """

    def __init__(self, node: Node, period_s: float) -> None:
        self._node, self._period_s = node, period_s
        self._steady = Clock(clock_type=ClockType.STEADY_TIME)
        self._said_ns: dict[str, int] = {}

    def __call__(self, text: str) -> None:
        """Say ``text``, unless that was just done."""
        kind, now_ns = NUMBER.sub('#', text), int(self._steady.now().nanoseconds)
        said_ns = self._said_ns.get(kind)
        if said_ns is None or seconds_between(said_ns, now_ns) >= self._period_s:
            self._said_ns.pop(kind, None)
            if len(self._said_ns) >= MOST:
                del self._said_ns[next(iter(self._said_ns))]
            self._said_ns[kind] = now_ns
            self._node.get_logger().warning(text)
