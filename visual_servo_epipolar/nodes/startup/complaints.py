"""Complaints of a node: problems logged at once and again while they last; missing inputs."""

from dataclasses import dataclass
import math
import re
from typing import Any

from rclpy.clock import Clock, ClockType
from rclpy.node import Node
from rclpy.qos import DurabilityPolicy, qos_check_compatible, QoSCompatibility
from rclpy.subscription import Subscription

from visual_servo_epipolar.core.stamps import NOT_ADVANCING, seconds_between
from visual_servo_epipolar.nodes.lifecycle.managed_node import ManagedNode
from visual_servo_epipolar.nodes.startup.guards import REPEAT_S

NUMBER = re.compile(r'[-+]?(?:\d[\d.]*(?:e[-+]?\d+)?|\b(?:nan|inf)\b)')
MOST = 100  # kinds of complaints that are remembered: texts of others may be in them
LOOK_PERIOD_S = 1.0
PATIENCE_S = 5.0  # time without a message, or without /clock, before it is logged
COMPRESSED = '/compressed'  # what image_transport puts after the name of the images
ANY_DRIVER = 'set camera_reliability: auto'


class Complaints:
    """
    Complaints of ``node``, as warnings, each at most once in ``period_s`` [s].

    Alike are those that differ in their numbers alone. rclpy's throttle goes by lines of code:
    one complaint would hide every other that comes from the same line.
    """

    def __init__(self, node: Node, period_s: float = 5.0) -> None:
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


@dataclass(frozen=True, slots=True)
class InputKind:
    """Kind of input: in words; what to do about its QoS; whether one message is enough."""

    what: str
    remedy: str = 'change the QoS of either side'
    once: bool = False


KINDS = {
    'image_raw': InputKind('images', ANY_DRIVER),
    f'image_raw{COMPRESSED}': InputKind('images', ANY_DRIVER),
    'camera_info': InputKind('the calibration of the camera', ANY_DRIVER, once=True),
    'tracks': InputKind('tracks of features'),
    'ground_truth': InputKind('the pose of the simulated robot'),
}


@dataclass(slots=True)
class Input:
    """Input: silent since it came last, or since that was logged; ``patience_s`` until it is."""

    kind: InputKind
    topic: str
    subscription: Subscription
    since_ns: int
    patience_s: float


class Inputs:
    """Subscriptions of ``node`` that are missed when silent, on the ``steady`` clock."""

    def __init__(self, node: Node, steady: Clock) -> None:
        self._node, self._steady = node, steady
        self._begin_ns, self._timeless_said = self._now_ns(), False
        self._kinds = {_full_name(node, topic): kind for topic, kind in KINDS.items()}
        self._inputs: dict[str, Input] = {}
        self._follow()

    def _follow(self) -> None:
        """Listen to the subscriptions that there are: a node may have made one anew."""
        for item in self._node.subscriptions:
            if item.topic_name in self._kinds and not item.raw:
                source = self._inputs.get(item.topic_name)
                if source is None or item is not source.subscription:
                    self._inputs[item.topic_name] = self._listen(item)

    def _listen(self, subscription: Subscription) -> Input:
        """Return an input that notices each message on its way to the callback."""
        topic = subscription.topic_name
        kind, durability = self._kinds[topic], subscription.qos_profile.durability
        # What was latched may have come before this subscription.
        latched = kind.once and durability == DurabilityPolicy.TRANSIENT_LOCAL
        patience_s = math.inf if latched else PATIENCE_S
        source = Input(kind, topic, subscription, self._now_ns(), patience_s)
        callback = subscription.callback

        def arrived(message: Any) -> None:
            source.since_ns = self._now_ns()
            source.patience_s = math.inf if kind.once else PATIENCE_S
            callback(message)

        subscription.callback = arrived
        return source

    def look(self) -> None:
        """Say what is missing: after a while, and silent inputs now and then again."""
        now = self._node.get_clock().now().nanoseconds
        timeless = self._node.get_parameter('use_sim_time').value and now == 0
        if timeless and not self._timeless_said and self._age(self._begin_ns) >= PATIENCE_S:
            self._timeless_said = True
            self._node.get_logger().warning(f'use_sim_time is true: {NOT_ADVANCING}')
        self._follow()
        for source in self._inputs.values():
            if self._age(source.since_ns) >= source.patience_s:
                source.since_ns, source.patience_s = self._now_ns(), REPEAT_S
                self._node.get_logger().warning(self._complaint(source))

    def _complaint(self, source: Input) -> str:
        topic = source.topic
        publishers = self._node.get_publishers_info_by_topic(topic)
        count = f'{len(publishers)} publisher{"" if len(publishers) == 1 else "s"}'
        return f'waits for {source.kind.what} on {topic} ({count}){self._hint(source, publishers)}'

    def _hint(self, source: Input, publishers: list[Any]) -> str:
        """Return what keeps messages from coming, as far as it can be seen from here."""
        if not publishers:
            beside = self._beside(source.topic) if source.kind.what == 'images' else ''
            return beside or '; start what publishes them, or remap the topic'
        message: Any = source.subscription.msg_type
        expected = f'{message.__module__.partition(".")[0]}/msg/{message.__name__}'
        kinds = sorted({item.topic_type for item in publishers})
        if expected not in kinds:
            return f'; they are {", ".join(kinds)}, it takes {expected}'
        checks = (
            qos_check_compatible(item.qos_profile, source.subscription.qos_profile)
            for item in publishers
        )
        refusals = [reason for level, reason in checks if level == QoSCompatibility.ERROR]
        if len(refusals) == len(publishers):
            refusal = refusals[0].removeprefix('ERROR: ').strip(' ;')
            return f'; their QoS does not fit: {refusal}; {source.kind.remedy}'
        names = {f'{item.node_namespace.rstrip("/")}/{item.node_name}' for item in publishers}
        return f'; nothing comes from {", ".join(sorted(names))}'

    def _beside(self, topic: str) -> str:
        """Return that the images come by the other transport, or ''."""
        compressed = topic.endswith(COMPRESSED)
        other = topic.removesuffix(COMPRESSED) if compressed else topic + COMPRESSED
        if not self._node.get_publishers_info_by_topic(other):
            return ''
        return f'; {other} has some: set transport: {"raw" if compressed else "compressed"}'

    def _age(self, stamp_ns: int) -> float:
        return seconds_between(stamp_ns, self._now_ns())

    def _now_ns(self) -> int:
        return int(self._steady.now().nanoseconds)


def _full_name(node: Node, topic: str) -> str:
    """Return the full name of ``topic``; that of compressed images follows the raw ones."""
    base = topic.removesuffix(COMPRESSED)
    return node.resolve_topic_name(base) + topic[len(base) :]


def watch(node: Node) -> None:
    """Let ``node`` say what it waits for: messages, and /clock where time is simulated."""
    steady = Clock(clock_type=ClockType.STEADY_TIME)
    timer = node.create_timer(LOOK_PERIOD_S, Inputs(node, steady).look, clock=steady)
    if isinstance(node, ManagedNode):
        node.keep(timer)
