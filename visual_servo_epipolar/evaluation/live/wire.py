"""The wire between real nodes: messages as events in simulated time, one after the other."""

from collections import defaultdict, deque
from collections.abc import Callable, Iterable, Iterator
from contextlib import contextmanager, ExitStack
from dataclasses import dataclass
from functools import partial
import heapq
import itertools
import traceback
from typing import Any

from rclpy.clock import Clock, ClockType
from rclpy.logging import get_logger
from rclpy.node import Node
from rclpy.publisher import Publisher
from rclpy.qos import DurabilityPolicy
from rclpy.serialization import deserialize_message, serialize_message
from rclpy.subscription import Subscription
from rclpy.time import Time
from rclpy.timer import Timer

from visual_servo_epipolar.core.stamps import NANOSECONDS


@dataclass(frozen=True, slots=True)
class ImageOrigin:
    """When an image was taken [ns, steady], and whether it shows what was there then."""

    taken_ns: int
    true: bool = True


@dataclass(slots=True)
class Envelope:
    """
    A message on ``topic``, under way for ``delay_ns``, made from what was seen as ``sight``.

    ``sender`` is the node that published it, '' while that is being made.
    """

    topic: str
    message: Any
    delay_ns: int
    sight: ImageOrigin | None = None
    sender: str = ''


# What a fault does to the messages of a topic: each becomes none, one or many.
Filter = Callable[[Envelope], Iterable[Envelope]]


HOP_NS = 2_000_000  # a message is under way that long where nothing is wrong
BEGIN_NS = 1_000 * NANOSECONDS  # of the steady clock
WALL_NS = 1_700_000_000 * NANOSECONDS  # of the wall clock, at that moment
FAR_NS = 2**63  # later than all else
WARNING = 30  # severity of a log

Delivery = Callable[[Node, Envelope], None]
Latched = DurabilityPolicy.TRANSIENT_LOCAL


class Wire:
    """
    Carries messages between ``nodes``, calls their timers, and tells the time [ns].

    Messages pass through CDR, as through any middleware. ``filters`` by topic do to them what a
    fault does; ``publish_listeners`` hear what is published, ``delivery_listeners``
    what arrives, and at which node. A callback that raises ends its node, as it would end its
    process.
    """

    def __init__(self) -> None:
        self.now_ns, self.offset_ns = BEGIN_NS, WALL_NS - BEGIN_NS
        self.nodes: list[Node] = []
        self.filters: dict[str, list[Filter]] = defaultdict(list)
        self.publish_listeners: dict[str, list[Callable[[Envelope], None]]] = defaultdict(list)
        self.delivery_listeners: dict[str, list[Delivery]] = defaultdict(list)
        self.logs: list[tuple[int, str, int, str]] = []  # time, node, severity, text
        self.crashes: list[str] = []
        self._events: list[tuple[int, int, Callable[[], object]]] = []
        self._numbers = itertools.count()
        self._due: dict[Timer, int] = {}
        self._hung: dict[Node, dict[Subscription, deque[Envelope]]] = {}
        self._latched: dict[str, Envelope] = {}
        self._sight: ImageOrigin | None = None  # of the envelope that is worked on
        self._running = ''  # the node that works

    @property
    def wall_ns(self) -> int:
        """What the wall clock shows."""
        return self.now_ns + self.offset_ns

    def add(self, node: Node) -> None:
        """Connect a node; what is latched reaches it."""
        self.nodes.append(node)
        for subscription in node.subscriptions:
            envelope = self._latched.get(subscription.topic_name)
            if envelope is not None and subscription.qos_profile.durability is Latched:
                arrive = partial(self._deliver, node, subscription, envelope)
                self.at(self.now_ns + HOP_NS, arrive)

    def remove(self, node: Node) -> None:
        """Disconnect a node, as if its process had gone."""
        if node in self.nodes:
            self.nodes.remove(node)
        self._hung.pop(node, None)

    def hang(self, node: Node) -> None:
        """Let a node do nothing; its queues keep what they are deep for."""
        self._hung.setdefault(node, {})

    def resume(self, node: Node) -> None:
        """Let a node go on, with what has waited for it."""
        for subscription, envelopes in self._hung.pop(node, {}).items():
            for envelope in envelopes:
                self._deliver(node, subscription, envelope)

    def forget(self, topic: str) -> None:
        """Hide from later subscribers what was latched on ``topic``."""
        self._latched.pop(topic, None)

    def works(self, node: Node) -> bool:
        """Return whether a node is connected and does not hang."""
        return node in self.nodes and node not in self._hung

    def at(self, moment_ns: int, act: Callable[[], object]) -> None:
        """Let ``act`` happen at ``moment_ns``, after what was set for then before."""
        heapq.heappush(self._events, (moment_ns, next(self._numbers), act))

    def send(self, envelope: Envelope) -> None:
        """Put an envelope on its way to all who subscribe to its topic when it arrives."""

        def arrive() -> None:
            for node, subscription in self._listeners(envelope.topic):
                self._deliver(node, subscription, envelope)

        self.at(self.now_ns + envelope.delay_ns, arrive)

    def post(self, envelope: Envelope) -> list[Envelope]:
        """Send what the faults of its topic make of an envelope, and return that."""
        envelopes = [envelope]
        for each in self.filters[envelope.topic]:
            envelopes = [after for before in envelopes for after in each(before)]
        for sent in envelopes:
            self.send(sent)
        return envelopes

    def publish(self, publisher: Publisher, message: Any) -> None:
        """Take what a node publishes; see ``hook_rclpy``."""
        topic = publisher.topic_name
        latched = publisher.qos_profile.durability is Latched
        if not (latched or self.publish_listeners[topic] or self._listeners(topic)):
            return
        raw = message if isinstance(message, bytes) else serialize_message(message)
        copy = deserialize_message(raw, publisher.msg_type)
        envelope = Envelope(topic, copy, HOP_NS, self._sight, self._running)
        for hear in self.publish_listeners[topic]:
            hear(envelope)
        for sent in self.post(envelope):
            if latched:
                self._latched[topic] = sent

    def run_until(self, moment_ns: int) -> None:
        """Let everything happen that is due until ``moment_ns``."""
        while True:
            timer, due_ns = self._next_timer()
            event_ns = self._events[0][0] if self._events else moment_ns + 1
            if min(due_ns, event_ns) > moment_ns:
                break
            self.now_ns = max(self.now_ns, min(due_ns, event_ns))
            if timer is not None and due_ns < event_ns:
                self._fire(timer)
            else:
                heapq.heappop(self._events)[2]()
        self.now_ns = moment_ns

    def call(self, node: Node, callback: Callable[..., Any], *arguments: Any) -> Any:
        """Let a node work; if it raises, its process is over."""
        if node not in self.nodes:
            return None
        before, self._running = self._running, str(node.get_name())
        try:
            return callback(*arguments)
        except Exception:  # as spin() of a process: whatever it is, it ends there
            self.crashes.append(f'{node.get_name()}: {traceback.format_exc()}')
            stop = getattr(node, 'stop', None)
            if stop is not None:
                stop()
            self.remove(node)
        finally:
            self._running = before
        return None

    def _listeners(self, topic: str) -> list[tuple[Node, Subscription]]:
        return [
            (node, item)
            for node in self.nodes
            for item in node.subscriptions
            if item.topic_name == topic
        ]

    def _deliver(self, node: Node, subscription: Subscription, envelope: Envelope) -> None:
        if node in self._hung:
            depth = max(subscription.qos_profile.depth, 1)
            self._hung[node].setdefault(subscription, deque(maxlen=depth)).append(envelope)
            return
        for hear in self.delivery_listeners[envelope.topic]:
            hear(node, envelope)
        before, self._sight = self._sight, envelope.sight
        message = serialize_message(envelope.message) if subscription.raw else envelope.message
        self.call(node, subscription.callback, message)
        self._sight = before

    def _next_timer(self) -> tuple[Timer | None, int]:
        """Return the timer that is due first, and when; a new one counts from now."""
        first, first_ns = None, FAR_NS
        for node in self.nodes:
            for timer in node.timers:
                due_ns = self._due.setdefault(timer, self.now_ns + timer.timer_period_ns)
                if due_ns < first_ns and not timer.is_canceled() and node not in self._hung:
                    first, first_ns = timer, due_ns
        return first, first_ns

    def _fire(self, timer: Timer) -> None:
        self._due[timer] = max(self._due[timer] + timer.timer_period_ns, self.now_ns + 1)
        node = next(node for node in self.nodes if timer in node.timers)
        self.call(node, timer.callback)


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

    def log(logger: Any, message: str, severity: int, **_: Any) -> bool:
        wire.logs.append((wire.now_ns, str(logger.name), int(severity), str(message)))
        return True

    with ExitStack() as stack:
        for kind, name, function in (
            (Clock, 'now', now),
            (Publisher, 'publish', publish),
            (Publisher, 'wait_for_all_acked', lambda publisher, timeout=None: True),
            (type(get_logger('wire')), 'log', log),
        ):
            stack.callback(setattr, kind, name, getattr(kind, name))
            setattr(kind, name, function)
        yield
