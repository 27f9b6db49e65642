"""Watch over a robot that drives: freshness of what it sees, stop button, heartbeat."""

from collections.abc import Callable
from typing import Any

from rclpy.clock import Clock
from rclpy.event_handler import SubscriptionEventCallbacks
from rclpy.node import Node
from rclpy.qos import QoSProfile
from std_msgs.msg import Bool

from visual_servo_epipolar.core.laws.phase import Phase
from visual_servo_epipolar.nodes import qos
from visual_servo_epipolar.nodes.managed import in_every_state, ManagedNode
from visual_servo_epipolar.nodes.steady import STEADY, Stopwatch

WATCH_PERIOD_S, IDLE_PERIOD_S = 0.05, 1.0  # of looks at what drives, and at what stands


class Freshness:
    """
    Stopwatches since tracks were ``heard``, ``fresh`` ones, since a ``step``, since it ``holds``.

    ``clock`` is that of the node, simulated or not: a simulated one stands still where its
    publisher dies, and the wall clock is set at times.
    """

    def __init__(self, clock: Clock) -> None:
        self._clock, self._time_ns, self._time = clock, -1, Stopwatch()
        self.heard, self.fresh, self.step = Stopwatch(), Stopwatch(), Stopwatch()
        self.holds = Stopwatch(runs=False)

    def follow(self, phase: Phase) -> None:
        """Note the phase that the servo is in."""
        if phase is not Phase.HOLDING:
            self.holds.stop()
        elif not self.holds.runs:
            self.holds.start()

    def clock_stands_still(self) -> float:
        """Look at the clock of the node, and return for how long it has stood still [s]."""
        time_ns = int(self._clock.now().nanoseconds)
        if time_ns != self._time_ns:
            self._time_ns = time_ns
            self._time.start()
        return self._time.seconds


# Of several buttons no message says which one sent it: one that is pressed still says so again.
RELEASE_S = 2.0
# One of the two subscriptions fits; that the other does not is no news.
NO_EVENTS = SubscriptionEventCallbacks(use_default_callbacks=False)
ENABLE = 'enable'  # the topic of the heartbeat


class StopButton:
    """
    Stop button of a ``node`` that drives, a std_msgs/Bool; ``on_press`` takes the reason.

    ``again`` is the service by which the robot drives after it.

    A true presses it. A false releases it where one button publishes. Of several the one that says
    false is not the one that was pressed: it is released where none has sent true for RELEASE_S,
    nor says so when those that are latched are asked anew.
    """

    def __init__(
        self, node: ManagedNode, on_press: Callable[[str], None], again: str = '~/start'
    ) -> None:
        self._node, self._on_press, self._again = node, on_press, again
        self._topic = node.resolve_topic_name('stop_button')
        self.pressed, self._said_again = False, False
        self._asking: tuple[Any, Any] | None = None  # subscription and timer of a doubtful release
        # Latched, so that a servo that is started in mid-press learns of it; and any other button.
        for profile in (qos.LATCHED_SWITCH, qos.SWITCH):
            self._subscribe(profile, self._on_button)

    @property
    def trouble(self) -> str:
        """That the button is pressed, and what to do; or ''."""
        again = f'the stop button is pressed; release it, then call {self._again}'
        return again if self.pressed else ''

    @in_every_state
    def _on_button(self, message: Bool) -> None:
        if message.data:
            self._press(message)
        elif self.pressed and self._node.count_publishers(self._topic) > 1:
            self._ask()
        elif self.pressed:
            self._release()

    @in_every_state
    def _press(self, message: Bool) -> None:
        """Press the button, if the message says so."""
        if not message.data:
            return
        was_pressed, self.pressed, self._said_again = self.pressed, True, True
        if not was_pressed:
            self._node.get_logger().warning(self.trouble)
            self._on_press('the stop button is pressed')

    def _release(self) -> None:
        self.pressed = False
        self._node.get_logger().info(
            f'the stop button is released; the robot stands until {self._again} is called'
        )

    def _ask(self) -> None:
        """Wait whether a button is pressed still: latched ones tell a new subscription."""
        if self._asking is not None:
            return
        self._said_again = False
        timer = self._node.create_timer(RELEASE_S, self._decide, clock=STEADY)
        self._asking = self._subscribe(qos.LATCHED_SWITCH, self._press), timer
        self._node.keep(timer)

    @in_every_state
    def _decide(self) -> None:
        """Release the button, unless one was pressed still."""
        assert self._asking is not None
        subscription, timer = self._asking
        self._node.destroy_subscription(subscription)
        self._node.destroy_timer(timer)
        self._asking = None
        if self.pressed and not self._said_again:
            self._release()

    def _subscribe(self, profile: QoSProfile, callback: Callable[[Bool], None]) -> Any:
        subscription = self._node.create_subscription(
            Bool, 'stop_button', callback, profile, event_callbacks=NO_EVENTS
        )
        self._node.keep(subscription)
        return subscription


class Enable:
    """Heartbeat not older than ``timeout`` [s] (0: none needed); a false stops at once."""

    def __init__(self, node: Node, timeout: float, on_withdrawn: Callable[[str], None]) -> None:
        self._timeout, self._on_withdrawn = timeout, on_withdrawn
        self._topic = node.resolve_topic_name(ENABLE)
        self._heard, self._enabled = Stopwatch(runs=False), False
        if timeout > 0.0:
            node.create_subscription(Bool, ENABLE, self._hear, qos.SWITCH)

    def withheld(self) -> str:
        """Return why the robot is not enabled now; or ''."""
        if self._timeout == 0.0:
            return ''
        if not self._heard.runs:
            return (
                f'no message has come on {self._topic} yet; publish a true there at least every '
                f'{self._timeout:g} s'
            )
        if not self._enabled:
            return f'{self._topic} is false'
        age = self._heard.seconds
        return f'the last true on {self._topic} is {age:.1f} s old' if age > self._timeout else ''

    @in_every_state  # what was enabled before may not be any more
    def _hear(self, message: Bool) -> None:
        self._heard.start()
        self._enabled = bool(message.data)
        if not self._enabled:
            self._on_withdrawn(self.withheld())
