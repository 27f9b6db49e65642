"""Raw subscriptions: they come and go with what is published, and hand on bytes."""

from collections import Counter
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any

from rclpy.event_handler import SubscriptionEventCallbacks
from rclpy.node import Node
from rclpy.qos import QoSProfile

from visual_servo_epipolar.bags.metadata import Topic
from visual_servo_epipolar.core.errors import InputError
from visual_servo_epipolar.nodes.lifecycle.gates import in_every_state
from visual_servo_epipolar.nodes.recording import discovery
from visual_servo_epipolar.nodes.recording.discovery import TopicSelection
from visual_servo_epipolar.nodes.startup.executor import hand_out


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
    Raw subscriptions of ``node``: one for every selected topic once somebody publishes it.

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
    def topics(self) -> frozenset[str]:
        """The topics that are subscribed, by their full names."""
        return frozenset(self._subscriptions)

    @property
    def missing(self) -> frozenset[str]:
        """The topics that are selected by name, but that nobody publishes."""
        return self._selection.named - self._subscriptions.keys()

    def discover(self) -> None:
        """Subscribe to topics that are new."""
        ignored = self._subscriptions.keys() | self.refused.keys()
        for name, kind in discovery.published_topics(self._node, self._selection, ignored):
            self._subscribe(discovery.offered_topic(self._node, name, kind))

    def refresh(self) -> None:
        """Weaken the QoS where less is offered now, and count lost messages."""
        for name, raw in self._subscriptions.items():
            offered = discovery.offered_topic(self._node, name, raw.topic.kind)
            if len(offered.qos) == 1:  # each of several publishers counts for itself
                self.lost[name] += raw.gaps
            raw.gaps = 0
            profile = discovery.compatible_qos(offered)
            if offered.qos and discovery.is_weaker(profile, raw.profile):
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
            discovery.message_class(topic.kind)
            self._on_topic(topic)
        except InputError as error:
            self.refused[topic.name] = str(error)
            self._node.get_logger().warning(f'{topic.name} is not recorded: {error}')
        else:
            profile = discovery.compatible_qos(topic)
            self._subscriptions[topic.name] = self._subscription(topic, profile)

    def _subscription(self, topic: Topic, profile: QoSProfile) -> RawSubscription:
        raw = RawSubscription(topic, profile)

        @in_every_state  # those that wait when the node is deactivated belong into the bag
        def listen(data: bytes, info: Mapping[str, int]) -> None:
            raw.count_gap(info['publication_sequence_number'])
            self._on_message(topic, data)

        raw.handle = self._node.create_subscription(
            discovery.message_class(topic.kind),
            topic.name,
            listen,  # type: ignore[arg-type] # raw, and with the info of the message
            profile,
            raw=True,
            # An executor looks at each event of each topic, time and again.
            event_callbacks=SubscriptionEventCallbacks(use_default_callbacks=False),
        )
        return raw
