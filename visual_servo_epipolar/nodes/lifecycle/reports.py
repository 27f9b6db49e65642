"""Reports that several nodes publish: diagnostics; settings and events, to replay bags with."""

from collections.abc import Sequence
from typing import Any

from diagnostic_msgs.msg import DiagnosticArray
from rclpy.clock import Clock, ClockType
from rclpy.event_handler import PublisherEventCallbacks
from rclpy.node import Node
from rclpy.publisher import Publisher
from rclpy.qos import QoSProfile
from std_msgs.msg import String

from visual_servo_epipolar.core.settings import Settings
from visual_servo_epipolar.core.stamps import seconds_between
from visual_servo_epipolar.messages import event_log, settings_text, write
from visual_servo_epipolar.nodes import qos


class NodeReports:
    """Reports of ``node``, under its full name."""

    def __init__(self, node: Node) -> None:
        self._node, self._name = node, node.get_fully_qualified_name()
        self._clock, self._steady = node.get_clock(), Clock(clock_type=ClockType.STEADY_TIME)
        self._diagnosed_ns = 0
        self._diagnostics_pub = self._publisher(DiagnosticArray, '/diagnostics', qos.DIAGNOSTICS)
        self._settings_pub = self._publisher(String, '~/settings', qos.LATCHED)
        self._events_pub = self._publisher(String, '~/events', qos.DIAGNOSTICS)

    def _publisher(self, kind: Any, topic: str, profile: QoSProfile) -> Publisher:
        """Create a publisher for people, silent about other QoS, which costs two entities."""
        silent = PublisherEventCallbacks(use_default_callbacks=False)
        return self._node.create_publisher(kind, topic, profile, event_callbacks=silent)

    @property
    def silence(self) -> float:
        """Time since the last diagnostics [s], on the steady clock."""
        return seconds_between(self._diagnosed_ns, self._steady.now().nanoseconds)

    def _diagnose(self, message: DiagnosticArray) -> None:
        self._diagnosed_ns = self._steady.now().nanoseconds
        self._diagnostics_pub.publish(message)

    def settings(self, groups: Sequence[Settings], after_stamp_ns: int | None) -> None:
        """Publish the settings in force, so that a bag can be replayed with them."""
        text = settings_text.to_text(self._name, groups, after_stamp_ns)
        self._settings_pub.publish(write.text(text))

    def event(
        self, name: str, after_stamp_ns: int | None, reason: str = '', at_ns: int | None = None
    ) -> None:
        """Publish what happened between two images, likewise."""
        entry = event_log.Entry(name, after_stamp_ns, reason, at_ns)
        self._events_pub.publish(write.text(event_log.to_text(entry)))
