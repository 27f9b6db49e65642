"""Subscriptions that come and go with what is published, and hand on bytes."""

from collections import Counter
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any

from rclpy.event_handler import SubscriptionEventCallbacks
from rclpy.node import Node
from rclpy.qos import QoSProfile

from visual_servo_epipolar.bags.storage import Topic
from visual_servo_epipolar.core.errors import InputError
from visual_servo_epipolar.nodes.recording import discovery
from visual_servo_epipolar.nodes.recording.discovery import Wish


@dataclass(slots=True)
class Ear:
    """A subscription, what is known of its topic, and the gaps in what was heard."""

    topic: Topic
    profile: QoSProfile
    subscription: Any = None
    last: int | None = None  # number of the last message, as its publisher counts them
    gaps: int = 0  # messages missing since the last check

    def notice(self, number: int) -> None:
        """Take note of the number of a message."""
        if self.last is not None and number > self.last:
            self.gaps += number - self.last - 1
        self.last = number


class Ears:
    """
    Subscribes ``node`` to every topic of ``wish`` once somebody publishes it.

    Parameters
    ----------
    begin : callable
        Told of each topic before its first message; may raise InputError to refuse it.
    take : callable
        Given a topic and the bytes of a message.

    """

    def __init__(
        self,
        node: Node,
        wish: Wish,
        begin: Callable[[Topic], None],
        take: Callable[[Topic, bytes], None],
    ) -> None:
        self._node, self._wish, self._begin, self._take = node, wish, begin, take
        self._ears: dict[str, Ear] = {}
        self.refused: dict[str, str] = {}  # topics that cannot be heard, and why
        self.lost: Counter[str] = Counter()  # messages that never arrived, by topic

    @property
    def heard(self) -> frozenset[str]:
        """The topics that are subscribed, by their full names."""
        return frozenset(self._ears)

    @property
    def all_heard(self) -> bool:
        """Whether all topics that were wished for by name are subscribed."""
        return not self.missing

    @property
    def missing(self) -> frozenset[str]:
        """The topics that are wished for by name, but that nobody publishes."""
        return self._wish.named - self._ears.keys()

    def look(self) -> None:
        """Subscribe to what is new."""
        known = self._ears.keys() | self.refused.keys()
        for name, kind in discovery.published(self._node, self._wish, known):
            self._open(discovery.offered(self._node, name, kind))

    def check(self) -> None:
        """Ask for less where less is offered now, and count what was lost."""
        for name, ear in self._ears.items():
            offers = discovery.offered(self._node, name, ear.topic.kind).qos
            if len(offers) == 1:  # each of several publishers counts for itself
                self.lost[name] += ear.gaps
            ear.gaps = 0
            profile = discovery.suitable(offers)
            if offers and discovery.is_weaker(profile, ear.profile):
                self._node.destroy_subscription(ear.subscription)
                self._ears[name] = self._subscribed(ear.topic, profile)

    def close(self) -> None:
        """Hear no more; ``look`` begins anew."""
        for ear in self._ears.values():
            self._node.destroy_subscription(ear.subscription)
        self._ears.clear()
        self.refused.clear()
        self.lost.clear()

    def _open(self, topic: Topic) -> None:
        try:
            discovery.message_class(topic.kind)
            self._begin(topic)
        except InputError as error:
            self.refused[topic.name] = str(error)
            self._node.get_logger().warning(f'{topic.name} is not recorded: {error}')
        else:
            profile = discovery.suitable(topic.qos)
            self._ears[topic.name] = self._subscribed(topic, profile)

    def _subscribed(self, topic: Topic, profile: QoSProfile) -> Ear:
        ear = Ear(topic, profile)

        def listen(data: bytes, info: Mapping[str, int]) -> None:
            ear.notice(info['publication_sequence_number'])
            self._take(topic, data)

        ear.subscription = self._node.create_subscription(
            discovery.message_class(topic.kind),
            topic.name,
            listen,
            profile,
            raw=True,
            # rclpy looks at each event of each topic for each message: a third of its time.
            event_callbacks=SubscriptionEventCallbacks(use_default_callbacks=False),
        )
        return ear
