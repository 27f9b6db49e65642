"""Conflicts of commands: other publishers on cmd_vel, and bases that take another message."""

from collections import Counter
from typing import Any

from rclpy.clock import Clock, ClockType
from rclpy.node import Node

from visual_servo_epipolar.core.stamps import seconds_between

TOPIC, MARKERS = 'cmd_vel', 'visualization_msgs/msg/MarkerArray'
STAMPED = {'geometry_msgs/Twist': 'false', 'geometry_msgs/TwistStamped': 'true'}
# A process that was killed is in the graph for twenty seconds more, the lease of Fast DDS.
LEFTOVER_S = 25.0
UNKNOWN = '_NODE_NAME_UNKNOWN_'  # of a program that is no node, or of one that has just come


class CommandConflicts:
    """
    Others that publish on the cmd_vel of ``node``: beside another servo none may drive.

    Any other publisher is named, no more: a multiplexer may be silent meanwhile, and a joystick
    may rest. So is a subscriber that takes another type of message.
    """

    def __init__(self, node: Node) -> None:
        self._node, self._steady = node, Clock(clock_type=ClockType.STEADY_TIME)
        self._twin_ns: int | None = None  # since when a second node has the same name

    def complaint(self) -> str:
        """Return that others command the base as well, or it takes no commands; or ''."""
        return self._complaint(self._look()) or type_mismatch(self._node)

    def notice(self) -> str:
        """Return what the owner of the base should know of its cmd_vel; or ''."""
        return '; '.join(filter(None, [type_mismatch(self._node), self._others()]))

    def _others(self) -> str:
        """Return that others than servos publish on the topic as well; '' if there are none."""
        servos = {*_rivals(self._node), self._node.get_fully_qualified_name()}
        names = sorted(set(publishers(self._node)) - servos)
        if not names:
            return ''
        topic = self._node.resolve_topic_name(TOPIC)
        named = ', '.join('an unknown program' if UNKNOWN in name else name for name in names)
        return (
            f'{named} may publish on {topic} as well, and the base would obey both in turns; '
            'stop it, or put a multiplexer between them and the base'
        )

    def refusal(self) -> str:
        """Return the complaint where no run may begin; a dead node of this name may linger."""
        names, own = self._look(), self._node.get_fully_qualified_name()
        return self._complaint(names if self.has_twin else [it for it in names if it != own])

    @property
    def has_twin(self) -> bool:
        """Whether a second node of the same name is there for so long that it must be alive."""
        now_ns = self._steady.now().nanoseconds
        return self._twin_ns is not None and seconds_between(self._twin_ns, now_ns) >= LEFTOVER_S

    def _look(self) -> list[str]:
        """Return the full names of rivals, and note since when one has the own name."""
        names = _rivals(self._node)
        if self._node.get_fully_qualified_name() not in names:
            self._twin_ns = None
        elif self._twin_ns is None:
            self._twin_ns = self._steady.now().nanoseconds
        return names

    def _complaint(self, names: list[str]) -> str:
        if not names:
            return ''
        return (
            f'{", ".join(names)} commands {self._node.resolve_topic_name(TOPIC)} as well, two '
            'servos would fight; end one, or give each a topic of its own and a multiplexer'
        )


def publishers(node: Node, topic: str = TOPIC) -> Counter[str]:
    """Return the full names of publishers on a ``topic`` of ``node``, and how often."""
    return Counter(map(_full_name, node.get_publishers_info_by_topic(topic)))


def type_mismatch(node: Node, *, takes: bool = False) -> str:
    """
    Return that others take another type of cmd_vel than ``node`` publishes, and what to do; or ''.

    Of a node that ``takes`` commands: that others publish another type.
    """
    ends = node.get_publishers_info_by_topic(TOPIC), node.get_subscriptions_info_by_topic(TOPIC)
    verbs, own = ('publishes', 'takes'), node.get_fully_qualified_name()
    types = {item.topic_type for item in ends[takes] if _full_name(item) == own}
    other = [item for item in ends[not takes] if types and item.topic_type not in types]
    if not other:
        return ''
    kinds = [kind.replace('/msg/', '/') for kind in (other[0].topic_type, min(types))]
    words = (
        f'{_full_name(other[0])} {verbs[not takes]} {kinds[0]} on '
        f'{node.resolve_topic_name(TOPIC)}, {own} {verbs[takes]} {kinds[1]}'
    )
    if kinds[0] not in STAMPED:
        return f'{words}: no command arrives; remap cmd_vel'
    stamped = STAMPED[kinds[0]]
    return f'{words}: no command arrives; restart {own} with enable_stamped_cmd_vel: {stamped}'


def _full_name(item: Any) -> str:
    """Return the full name of the node that has an end of a topic."""
    return f'{item.node_namespace.rstrip("/")}/{item.node_name}'


def _rivals(node: Node) -> list[str]:
    names = publishers(node)
    names[node.get_fully_qualified_name()] -= 1
    topics = dict(node.get_topic_names_and_types())
    return sorted(
        name
        for name, count in names.items()
        if count > 0 and MARKERS in topics.get(f'{name}/markers', [])
    )
