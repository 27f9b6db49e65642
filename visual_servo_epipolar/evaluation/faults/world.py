"""The world of a run: real nodes on a wire, in simulated time; killed, restarted at will."""

from collections import defaultdict
from collections.abc import Callable, Iterable, Iterator, Mapping
from contextlib import contextmanager, ExitStack
from dataclasses import asdict, dataclass, field
from functools import partial
import heapq
import itertools
import traceback
from typing import Any

from rclpy.clock import Clock, ClockType
from rclpy.context import Context
from rclpy.logging import get_logger
from rclpy.node import Node
from rclpy.parameter import Parameter
from rclpy.publisher import Publisher
from rclpy.qos import DurabilityPolicy
from rclpy.serialization import deserialize_message, serialize_message
from rclpy.subscription import Subscription
from rclpy.time import Time
from rclpy.timer import Timer

from visual_servo_epipolar.core.servo.settings import ServoSettings
from visual_servo_epipolar.core.stamps import NANOSECONDS
from visual_servo_epipolar.core.tracking.settings import TrackerSettings
from visual_servo_epipolar.nodes.camera_node import CameraNode
from visual_servo_epipolar.nodes.servo_node import ServoNode
from visual_servo_epipolar.nodes.startup.run import isolated_context, new_node
from visual_servo_epipolar.nodes.tracker_node import TrackerNode
from visual_servo_epipolar.nodes.unicycle_node import UnicycleNode
from visual_servo_epipolar.simulation.bases import PioneerSettings
from visual_servo_epipolar.simulation.cameras import CameraSettings


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
        self.now_ns, self.offset_ns = BEGIN_NS, 1_700_000_000 * NANOSECONDS - BEGIN_NS
        self.nodes: list[Node] = []
        self.filters: dict[str, list[Filter]] = defaultdict(list)
        self.publish_listeners: dict[str, list[Callable[[Envelope], None]]] = defaultdict(list)
        self.delivery_listeners: dict[str, list[Delivery]] = defaultdict(list)
        self.logs: list[tuple[int, str, int, str]] = []  # time, node, severity, text
        self.crashes: list[str] = []
        self._events: list[tuple[int, int, Callable[[], object]]] = []
        self._numbers = itertools.count()
        self._due: dict[Timer, int] = {}
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

    def at(self, moment_ns: int, act: Callable[[], object]) -> None:
        """Let ``act`` happen at ``moment_ns``, after what was set for then before."""
        heapq.heappush(self._events, (moment_ns, next(self._numbers), act))

    def send(self, envelope: Envelope) -> None:
        """Put an envelope on its way to all subscribers of its topic when it arrives."""

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
        for hear in self.delivery_listeners[envelope.topic]:
            hear(node, envelope)
        before, self._sight = self._sight, envelope.sight
        message = serialize_message(envelope.message) if subscription.raw else envelope.message
        self.call(node, subscription.callback, message)
        self._sight = before

    def _next_timer(self) -> tuple[Timer | None, int]:
        """Return the timer that is due first, and when; a new one counts from now."""
        first, first_ns = None, 2**63  # later than all else
        for node in self.nodes:
            for timer in node.timers:
                due_ns = self._due.setdefault(timer, self.now_ns + timer.timer_period_ns)
                if due_ns < first_ns and not timer.is_canceled():
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
    publisher withholds is not.
    """

    def now(clock: Clock) -> Time:
        if clock.clock_type is ClockType.STEADY_TIME:
            return Time(nanoseconds=wire.now_ns, clock_type=clock.clock_type)
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


NODES: Mapping[str, type[Any]] = {
    'servo_node': ServoNode,
    'tracker_node': TrackerNode,
    'camera_node': CameraNode,
    'unicycle_node': UnicycleNode,
}


@dataclass(frozen=True, kw_only=True)
class WorldSettings:
    """How a world is built."""

    start: tuple[float, float, float]
    seed: int
    camera: CameraSettings
    base: PioneerSettings = field(default_factory=PioneerSettings)
    servo: ServoSettings = field(
        default_factory=lambda: ServoSettings(autostart=True, run_timeout=150.0, max_retreat=1.0)
    )


class World:
    """
    Real nodes and a wire; no other process sees them.

    ``nodes`` are those that live, by name. What happens to one is what happens to its process.
    """

    def __init__(self, settings: WorldSettings, wire: Wire, context: Context) -> None:
        self.settings, self.wire, self._context = settings, wire, context
        self.nodes: dict[str, Node] = {}

    def start(self, name: str) -> None:
        """Start a node, or replace the one that is there."""
        self.kill(name)
        node = new_node(NODES[name], self._context, self._values(name))
        self.nodes[name] = node
        self.wire.add(node)

    def kill(self, name: str) -> None:
        """Let a node be gone, without a word."""
        node = self.nodes.pop(name, None)
        if node is not None:
            self.wire.remove(node)
            node.destroy_node()

    def end(self, name: str) -> None:
        """End a node as SIGINT does."""
        node = self.nodes.get(name)
        stop = getattr(node, 'stop', None)
        if node is not None and stop is not None:
            self.wire.call(node, stop)
        self.kill(name)

    def works(self, name: str) -> bool:
        """Return whether a node lives: one that raised is over."""
        return self.nodes.get(name) in self.wire.nodes

    def call(self, service: str) -> str:
        """Call a service (std_srvs/Trigger), as /servo_node/stop, and return its answer, or ''."""
        for node in list(self.nodes.values()):
            for item in node.services:
                if item.service_name == service:
                    kind: Any = item.srv_type
                    answer = self.wire.call(node, item.callback, kind.Request(), kind.Response())
                    return '' if answer is None else str(answer.message)
        return ''

    def set(self, name: str, values: Mapping[str, Any]) -> str:
        """Set parameters of a node, all or none, and return why it refused, or ''."""
        node = self.nodes.get(name)
        if node is None:
            return f'no {name}'
        wanted = [Parameter(key, value=value) for key, value in values.items()]
        result = self.wire.call(node, node.set_parameters_atomically, wanted)
        return '' if result is None or result.successful else str(result.reason)

    @property
    def delay_s(self) -> float:
        """How long a command takes to the motors, by now [s]."""
        base = self.nodes.get('unicycle_node')
        return 0.0 if base is None else float(base.get_parameter('command_delay').value)

    def run_for(self, seconds: float) -> None:
        """Let time pass."""
        self.wire.run_until(self.wire.now_ns + round(seconds * NANOSECONDS))

    def _values(self, name: str) -> dict[str, Any]:
        it = self.settings
        if name == 'unicycle_node':
            return {
                **asdict(it.base),
                'start': it.start,
                'seed': it.seed,
                'rate': 50.0,
                'frame_rate': it.camera.frame_rate,
            }
        own = {'servo_node': it.servo, 'camera_node': it.camera, 'tracker_node': TrackerSettings()}
        return asdict(own[name])


@contextmanager
def open_world(settings: WorldSettings) -> Iterator[World]:
    """Yield a world without nodes; those that are started end with the block."""
    wire = Wire()
    with isolated_context() as context, hook_rclpy(wire):
        world = World(settings, wire, context)
        try:
            yield world
        finally:
            for name in NODES:
                world.kill(name)


def small_camera(seed: int) -> CameraSettings:
    """Return the default camera with 4x4 pixels binned."""
    return CameraSettings(seed=seed).resized(320, 256)
