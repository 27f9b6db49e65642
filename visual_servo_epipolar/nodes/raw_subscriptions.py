"""
Raw subscriptions: they follow the topics that are published, and pass on bytes.

Which topics are selected, and the QoS that their publishers offer, is looked up periodically.
"""

from collections import Counter
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from fnmatch import fnmatchcase
from functools import partial
from importlib import import_module
from importlib.util import find_spec
from pathlib import Path
import re
from typing import Any

from rclpy.duration import Duration
from rclpy.event_handler import SubscriptionEventCallbacks
from rclpy.node import Node
from rclpy.qos import DurabilityPolicy, HistoryPolicy, QoSProfile, ReliabilityPolicy

from visual_servo_epipolar.bags.recording.recorder import Topic
from visual_servo_epipolar.core.errors import InputError
from visual_servo_epipolar.core.stamps import NANOSECONDS
from visual_servo_epipolar.nodes.managed import CLOCK, in_every_state
from visual_servo_epipolar.nodes.startup.run import hand_out

# Messages that may wait in DDS while this process does something else: 3 s of images at 30 Hz,
# 5 s of small ones at 200 Hz.
IMAGE_DEPTH, DEPTH = 100, 1000
MESSAGE_TYPE = re.compile(r'([a-z][a-z0-9_]*)/msg/([A-Z][A-Za-z0-9]*)')


@dataclass(frozen=True, slots=True)
class TopicSelection:
    """Topics by name or pattern (* and ?), but ``exclude``; relative to the node's namespace."""

    names: tuple[str, ...]
    exclude: tuple[str, ...] = ()

    def resolved(self, node: Node) -> 'TopicSelection':
        """Return the selection in full names, remapped as ``node`` is."""
        groups = self.names, self.exclude
        return TopicSelection(*(tuple(_full(node, it) for it in each if it) for each in groups))

    def selects(self, topic: str) -> bool:
        """Return whether a topic, by its full name, is selected."""
        matches = partial(fnmatchcase, topic)
        return any(map(matches, self.names)) and not any(map(matches, self.exclude))

    @property
    def named(self) -> frozenset[str]:
        """The topics that are selected by name; /clock is there in simulated time alone."""
        return frozenset(
            name
            for name in self.names
            if name != CLOCK and not _is_pattern(name) and self.selects(name)
        )


@dataclass(slots=True)
class RawSubscription:
    """Raw subscription: its topic and QoS, and the gaps in the sequence of its messages."""

    topic: Topic
    profile: QoSProfile
    handle: Any = None
    last_number: int | None = None  # sequence number of the last message
    gaps: int = 0  # messages missing since the last check

    def count_gap(self, number: int) -> None:
        """Count the messages missing before that with the sequence number ``number``."""
        if self.last_number is not None and number > self.last_number:
            self.gaps += number - self.last_number - 1
        self.last_number = number


class RawSubscriptions:
    """
    Raw subscriptions of ``node``: one for every selected topic once it is published.

    ``on_topic`` is called for each topic before its first message, and may raise InputError to
    refuse it; ``on_message`` with a topic and the bytes of a message.
    """

    def __init__(
        self,
        node: Node,
        selection: TopicSelection,
        on_topic: Callable[[Topic], None],
        on_message: Callable[[Topic, bytes], None],
    ) -> None:
        self._node, self._selection = node, selection
        self._on_topic, self._on_message = on_topic, on_message
        self._subscriptions: dict[str, RawSubscription] = {}
        self.refused: dict[str, str] = {}  # topics that cannot be subscribed, and why
        self.lost: Counter[str] = Counter()  # messages that never arrived, by topic

    @property
    def missing(self) -> frozenset[str]:
        """The topics that are selected by name, but not published."""
        return self._selection.named - self._subscriptions.keys()

    def discover(self) -> None:
        """Subscribe to topics that are new."""
        ignored = self._subscriptions.keys() | self.refused.keys()
        for name, kinds in self._node.get_topic_names_and_types():
            is_new = name not in ignored and len(kinds) == 1 and self._selection.selects(name)
            if is_new and self._node.count_publishers(name):
                self._subscribe(offered_topic(self._node, name, kinds[0]))

    def refresh(self) -> None:
        """Weaken the QoS where less is offered now, and count lost messages."""
        for name, raw in self._subscriptions.items():
            offered = offered_topic(self._node, name, raw.topic.kind)
            if len(offered.qos) == 1:  # each of several publishers counts for itself
                self.lost[name] += raw.gaps
            raw.gaps = 0
            profile = compatible_qos(offered)
            if offered.qos and is_weaker(profile, raw.profile):
                self._node.destroy_subscription(raw.handle)
                self._subscriptions[name] = self._subscription(raw.topic, profile)

    def drain(self) -> None:
        """Hand on what has arrived, but waits in DDS for this process."""
        if not self._node.context.ok():
            return
        for raw in self._subscriptions.values():
            for _ in range(raw.profile.depth):
                if not hand_out(raw.handle):
                    break

    def close(self) -> None:
        """Drop all subscriptions; ``discover`` begins anew."""
        for raw in self._subscriptions.values():
            self._node.destroy_subscription(raw.handle)
        self._subscriptions.clear()
        self.refused.clear()
        self.lost.clear()

    def _subscribe(self, topic: Topic) -> None:
        try:
            message_class(topic.kind)
            self._on_topic(topic)
        except InputError as error:
            self.refused[topic.name] = str(error)
            self._node.get_logger().warning(f'{topic.name} is not recorded: {error}')
        else:
            profile = compatible_qos(topic)
            self._subscriptions[topic.name] = self._subscription(topic, profile)

    def _subscription(self, topic: Topic, profile: QoSProfile) -> RawSubscription:
        raw = RawSubscription(topic, profile)

        @in_every_state  # those that wait when the node is deactivated belong into the bag
        def listen(data: bytes, info: Mapping[str, int]) -> None:
            raw.count_gap(info['publication_sequence_number'])
            self._on_message(topic, data)

        raw.handle = self._node.create_subscription(
            message_class(topic.kind),
            topic.name,
            listen,  # type: ignore[arg-type] # raw, and with the info of the message
            profile,
            raw=True,
            # An executor looks at each event of each topic, time and again.
            event_callbacks=SubscriptionEventCallbacks(use_default_callbacks=False),
        )
        return raw


def offered_topic(node: Node, name: str, kind: str) -> Topic:
    """Return a topic with the QoS that its publishers offer."""
    infos = [item for item in node.get_publishers_info_by_topic(name) if item.topic_type == kind]
    hashes = {str(item.topic_type_hash) for item in infos}
    return Topic(
        name,
        kind,
        hashes.pop() if len(hashes) == 1 else '',
        tuple(_qos_entry(item.qos_profile) for item in infos),
    )


def compatible_qos(topic: Topic) -> QoSProfile:
    """Return the strongest profile that is compatible with every offer of a topic."""
    reliable = all(item['reliability'] == 'reliable' for item in topic.qos)
    latched = all(item['durability'] == 'transient_local' for item in topic.qos)
    return QoSProfile(
        history=HistoryPolicy.KEEP_LAST,
        depth=IMAGE_DEPTH if topic.kind == 'sensor_msgs/msg/Image' else DEPTH,
        reliability=ReliabilityPolicy.RELIABLE if reliable else ReliabilityPolicy.BEST_EFFORT,
        durability=DurabilityPolicy.TRANSIENT_LOCAL if latched else DurabilityPolicy.VOLATILE,
    )


def is_weaker(profile: QoSProfile, than: QoSProfile) -> bool:
    """Return whether a profile asks for less, so that it connects to more publishers."""
    return (profile.reliability, profile.durability) != (than.reliability, than.durability) and (
        profile.reliability in (than.reliability, ReliabilityPolicy.BEST_EFFORT)
        and profile.durability in (than.durability, DurabilityPolicy.VOLATILE)
    )


def message_class(kind: str) -> Any:
    """Return the class of a message type; raises InputError, and imports nothing but messages."""
    names = MESSAGE_TYPE.fullmatch(kind)
    if names is None:
        raise InputError(f'{kind!r:.80} is no type of messages; expected package/msg/Name')
    package, name = names.groups()
    try:
        if not _has_messages(package):
            raise ImportError
        message: Any = getattr(import_module(f'{package}.msg'), name)
        message.get_fields_and_field_types  # noqa: B018 - what every generated message has
    except (ImportError, AttributeError):
        raise InputError(
            f'{kind} cannot be imported; source the workspace that defines it'
        ) from None
    return message


def _has_messages(package: str) -> bool:
    """Return whether a package has a folder ``msg``, without importing anything of it."""
    spec = find_spec(package)
    folders = (spec.submodule_search_locations or ()) if spec is not None else ()
    return any(Path(folder, 'msg', '__init__.py').is_file() for folder in folders)


def _is_pattern(name: str) -> bool:
    return any(sign in name for sign in '*?[')


def _full(node: Node, name: str) -> str:
    if name == CLOCK[1:]:
        return CLOCK  # there is one for all namespaces
    if name.startswith(('/', '*')):
        return name
    if _is_pattern(name):
        return f'{node.get_namespace().rstrip("/")}/{name}'
    try:
        return node.resolve_topic_name(name)
    except (RuntimeError, ValueError) as error:  # InvalidTopicNameException, of rcl
        text = str(error).partition(', at ')[0]
        raise InputError(
            f'topics and exclude must be names or patterns, got {name!r}: {text}'
        ) from None


def _qos_entry(profile: QoSProfile) -> dict[str, Any]:
    """Return a profile as in metadata.yaml of a bag."""
    return {
        'history': profile.history.short_key,
        'depth': profile.depth,
        'reliability': profile.reliability.short_key,
        'durability': profile.durability.short_key,
        'deadline': _time(profile.deadline),
        'lifespan': _time(profile.lifespan),
        'liveliness': profile.liveliness.short_key,
        'liveliness_lease_duration': _time(profile.liveliness_lease_duration),
        'avoid_ros_namespace_conventions': profile.avoid_ros_namespace_conventions,
    }


def _time(duration: Duration) -> dict[str, int]:
    sec, nsec = divmod(duration.nanoseconds, NANOSECONDS)
    return {'sec': sec, 'nsec': nsec}
