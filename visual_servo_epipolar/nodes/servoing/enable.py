"""Enable: a heartbeat of who lets the robot drive; without it the robot stands."""

from collections.abc import Callable

from rclpy.clock import Clock, ClockType
from rclpy.node import Node
from std_msgs.msg import Bool

from visual_servo_epipolar.core.stamps import seconds_between
from visual_servo_epipolar.nodes import qos

TOPIC = 'enable'


class Enable:
    """
    Heartbeat on ``enable`` of ``node``, a std_msgs/Bool, that is not older than ``timeout`` [s].

    With 0 nobody has to send one. ``on_withdrawn`` is told of a false at once.
    """

    def __init__(self, node: Node, timeout: float, on_withdrawn: Callable[[str], None]) -> None:
        self._timeout, self._on_withdrawn = timeout, on_withdrawn
        self._topic = node.resolve_topic_name(TOPIC)
        self._steady = Clock(clock_type=ClockType.STEADY_TIME)
        self._heard_ns: int | None = None
        self._enabled = False
        if timeout > 0.0:
            node.create_subscription(Bool, TOPIC, self._hear, qos.SWITCH)

    def withheld(self) -> str:
        """Return why the robot is not enabled now; or ''."""
        if self._timeout == 0.0:
            return ''
        if self._heard_ns is None:
            return (
                f'no message has come on {self._topic} yet; publish a true there at least every '
                f'{self._timeout:g} s'
            )
        if not self._enabled:
            return f'{self._topic} is false'
        age = seconds_between(self._heard_ns, int(self._steady.now().nanoseconds))
        return f'the last true on {self._topic} is {age:.1f} s old' if age > self._timeout else ''

    def _hear(self, message: Bool) -> None:
        self._heard_ns = int(self._steady.now().nanoseconds)
        self._enabled = bool(message.data)
        if not self._enabled:
            self._on_withdrawn(self.withheld())
