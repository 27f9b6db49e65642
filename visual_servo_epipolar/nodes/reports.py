"""Reports of nodes: diagnostics; settings and events, to replay bags with; complaints logged."""

from collections.abc import Sequence
import re
from typing import Any

from diagnostic_msgs.msg import DiagnosticArray
from rclpy.event_handler import PublisherEventCallbacks
from rclpy.node import Node
from rclpy.publisher import Publisher
from rclpy.qos import QoSProfile
from std_msgs.msg import String

from visual_servo_epipolar.core.settings import Settings
from visual_servo_epipolar.messages import event_log, settings_text, write
from visual_servo_epipolar.nodes import qos
from visual_servo_epipolar.nodes.steady import Stopwatch

NUMBER = re.compile(r'[-+]?(?:\d[\d.]*(?:e[-+]?\d+)?|\b(?:nan|inf)\b)')


class Complaints:
    """
    Complaints of ``node``, as warnings, each at most once in ``period_s`` [s].

    Alike are those that differ in their numbers alone. rclpy's throttle goes by lines of code:
    one complaint would hide every other that comes from the same line.
    """

    def __init__(self, node: Node, period_s: float = 5.0) -> None:
        self._node, self._period_s = node, period_s
        self._said: dict[str, Stopwatch] = {}

    def __call__(self, text: str) -> None:
        """Say ``text``, unless that was just done."""
        kind = NUMBER.sub('#', text)
        if kind in self._said and self._said[kind].seconds < self._period_s:
            return
        # Texts of others may be in them: those that may be said again are forgotten.
        recent = {it: said for it, said in self._said.items() if said.seconds < self._period_s}
        self._said = {**recent, kind: Stopwatch()}
        self._node.get_logger().warning(text)


class NodeReports:
    """Reports of ``node``, under its full name."""

    def __init__(self, node: Node) -> None:
        self._node, self._name = node, node.get_fully_qualified_name()
        self._clock, self._diagnosed = node.get_clock(), Stopwatch(runs=False)
        self._diagnostics_pub = self._publisher(DiagnosticArray, '/diagnostics', qos.DIAGNOSTICS)
        self._settings_pub = self._publisher(String, '~/settings', qos.LATCHED)

    def _publisher(self, kind: Any, topic: str, profile: QoSProfile) -> Publisher:
        """Create a publisher for people, silent about other QoS, which costs two entities."""
        silent = PublisherEventCallbacks(use_default_callbacks=False)
        return self._node.create_publisher(kind, topic, profile, event_callbacks=silent)

    @property
    def silence(self) -> float:
        """Time since the last diagnostics [s], on the steady clock."""
        return self._diagnosed.seconds

    def _diagnose(self, message: DiagnosticArray) -> None:
        self._diagnosed.start()
        self._diagnostics_pub.publish(message)

    def settings(self, groups: Sequence[Settings], after_stamp_ns: int | None) -> None:
        """Publish the settings in force, so that a bag can be replayed with them."""
        text = settings_text.to_text(self._name, groups, after_stamp_ns)
        self._settings_pub.publish(write.text(text))


class ReplayReports(NodeReports):
    """Reports of a ``node`` whose bags are replayed: its events as well."""

    def __init__(self, node: Node) -> None:
        super().__init__(node)
        self._events_pub = self._publisher(String, '~/events', qos.DIAGNOSTICS)

    def event(self, name: str, after_stamp_ns: int | None, reason: str = '') -> None:
        """Publish what happened between two images."""
        entry = event_log.Entry(name, after_stamp_ns, reason)
        self._events_pub.publish(write.text(event_log.to_text(entry)))
