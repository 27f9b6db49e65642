"""Rivals: other servos that command the same base."""

from collections import Counter

from rclpy.node import Node

TOPIC, MARKERS = 'cmd_vel', 'visualization_msgs/msg/MarkerArray'


def rivals(node: Node) -> list[str]:
    """
    Return the full names of other servos that publish on the cmd_vel of ``node``.

    Its own name says that a second node has it; for some seconds that may be one that was killed.
    """
    names = Counter(
        f'{item.node_namespace.rstrip("/")}/{item.node_name}'
        for item in node.get_publishers_info_by_topic(TOPIC)
    )
    names[node.get_fully_qualified_name()] -= 1
    topics = dict(node.get_topic_names_and_types())
    return sorted(
        name
        for name, count in names.items()
        if count > 0 and MARKERS in topics.get(f'{name}/markers', [])
    )


def complaint(node: Node, *, fatal: bool = False) -> str:
    """
    Return that others command the base as well, and what to do; '' if there are none.

    ``fatal``: only where no run may begin beside them, not by what is left of a killed one.
    """
    others = rivals(node)
    if not others or fatal and others == [node.get_fully_qualified_name()]:
        return ''
    return (
        f'{", ".join(others)} commands {node.resolve_topic_name(TOPIC)} as well, two servos would '
        'fight; end one, or give each a topic of its own and a multiplexer'
    )
