"""The wire between real nodes: events in simulated time, one after the other."""

from collections import defaultdict, deque
from collections.abc import Callable
import heapq
import itertools
import traceback
from typing import Any

from rclpy.node import Node
from rclpy.publisher import Publisher
from rclpy.qos import DurabilityPolicy
from rclpy.serialization import deserialize_message, serialize_message
from rclpy.subscription import Subscription
from rclpy.timer import Timer

from visual_servo_epipolar.core.stamps import NANOSECONDS
from visual_servo_epipolar.evaluation.faults.wire.parcel import Filter, Parcel, Sight

HOP_NS = 2_000_000  # a message is under way that long where nothing is wrong
BEGIN_NS = 1_000 * NANOSECONDS  # of the steady clock
WALL_NS = 1_700_000_000 * NANOSECONDS  # of the wall clock, at that moment
FAR_NS = 2**63  # later than all else
WARNING = 30  # severity of a log

Latched = DurabilityPolicy.TRANSIENT_LOCAL


class Wire:
    """
    Carries messages between ``nodes``, calls their timers, and tells the time [ns].

    Messages pass through CDR, as through any middleware. ``filters`` by topic do to them what a
    fault does; ``taps`` hear what is published, ``ears`` what arrives, and at which node. A
    callback that raises ends its node, as it would end its process.
    """

    def __init__(self) -> None:
        self.now_ns, self.offset_ns = BEGIN_NS, WALL_NS - BEGIN_NS
        self.nodes: list[Node] = []
        self.filters: dict[str, list[Filter]] = defaultdict(list)
        self.taps: dict[str, list[Callable[[Parcel], None]]] = defaultdict(list)
        self.ears: dict[str, list[Callable[[Node, Parcel], None]]] = defaultdict(list)
        self.logs: list[tuple[int, str, int, str]] = []  # time, node, severity, text
        self.crashes: list[str] = []
        self._events: list[tuple[int, int, Callable[[], object]]] = []
        self._numbers = itertools.count()
        self._due: dict[Timer, int] = {}
        self._hung: dict[Node, dict[Subscription, deque[Parcel]]] = {}
        self._latched: dict[str, Parcel] = {}
        self._sight: Sight | None = None  # of the parcel that is worked on
        self._running = ''  # the node that works

    @property
    def wall_ns(self) -> int:
        """What the wall clock shows."""
        return self.now_ns + self.offset_ns

    def add(self, node: Node) -> None:
        """Connect a node; what is latched reaches it."""
        self.nodes.append(node)
        for subscription in node.subscriptions:
            parcel = self._latched.get(subscription.topic_name)
            if parcel is not None and subscription.qos_profile.durability is Latched:
                self.at(self.now_ns + HOP_NS, self._delivery(node, subscription, parcel))

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
        for subscription, parcels in self._hung.pop(node, {}).items():
            for parcel in parcels:
                self._deliver(node, subscription, parcel)

    def forget(self, topic: str) -> None:
        """Let nobody who comes later hear what was latched on ``topic``."""
        self._latched.pop(topic, None)

    def works(self, node: Node) -> bool:
        """Return whether a node is connected and does not hang."""
        return node in self.nodes and node not in self._hung

    def at(self, moment_ns: int, act: Callable[[], object]) -> None:
        """Let ``act`` happen at ``moment_ns``, after what was set for then before."""
        heapq.heappush(self._events, (moment_ns, next(self._numbers), act))

    def send(self, parcel: Parcel) -> None:
        """Put a parcel on its way to all who subscribe to its topic when it arrives."""
        self.at(self.now_ns + parcel.delay_ns, lambda: self._arrive(parcel))

    def post(self, parcel: Parcel) -> list[Parcel]:
        """Send what the faults of its topic make of a parcel, and return that."""
        parcels = [parcel]
        for each in self.filters[parcel.topic]:
            parcels = [after for before in parcels for after in each(before)]
        for sent in parcels:
            self.send(sent)
        return parcels

    def publish(self, publisher: Publisher, message: Any) -> None:
        """Take what a node publishes; see ``hooks``."""
        topic = publisher.topic_name
        latched = publisher.qos_profile.durability is Latched
        if not (latched or self.taps[topic] or self._listeners(topic)):
            return
        raw = message if isinstance(message, bytes) else serialize_message(message)
        copy = deserialize_message(raw, publisher.msg_type)
        parcel = Parcel(topic, copy, HOP_NS, self._sight, self._running)
        for tap in self.taps[topic]:
            tap(parcel)
        for sent in self.post(parcel):
            if latched:
                self._latched[topic] = sent

    def log(self, node: str, severity: int, text: str) -> None:
        """Take what a node logs; see ``hooks``."""
        self.logs.append((self.now_ns, node, severity, text))

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

    def _arrive(self, parcel: Parcel) -> None:
        for node, subscription in self._listeners(parcel.topic):
            self._deliver(node, subscription, parcel)

    def _delivery(
        self, node: Node, subscription: Subscription, parcel: Parcel
    ) -> Callable[[], None]:
        return lambda: self._deliver(node, subscription, parcel)

    def _deliver(self, node: Node, subscription: Subscription, parcel: Parcel) -> None:
        if node in self._hung:
            depth = max(subscription.qos_profile.depth, 1)
            self._hung[node].setdefault(subscription, deque(maxlen=depth)).append(parcel)
            return
        for hear in self.ears[parcel.topic]:
            hear(node, parcel)
        before, self._sight = self._sight, parcel.sight
        message = serialize_message(parcel.message) if subscription.raw else parcel.message
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
