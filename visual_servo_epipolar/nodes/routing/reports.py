"""Reports of the route node: phase, progress, the path as taught; settings, events for bags."""

from collections.abc import Sequence

from diagnostic_msgs.msg import DiagnosticArray
from nav_msgs.msg import Path
from rclpy.clock import Clock, ClockType
from rclpy.node import Node
from sensor_msgs.msg import JointState
from std_msgs.msg import String
from visualization_msgs.msg import MarkerArray

from visual_servo_epipolar.core.routes.route import Route
from visual_servo_epipolar.core.routes.run import RouteStep
from visual_servo_epipolar.core.settings import Settings
from visual_servo_epipolar.core.stamps import seconds_between
from visual_servo_epipolar.messages import event_log, settings_text, write
from visual_servo_epipolar.messages.event_log import Entry
from visual_servo_epipolar.messages.routes import route_messages
from visual_servo_epipolar.nodes import qos
from visual_servo_epipolar.nodes.qos import report_publisher


class RouteReports:
    """Reports of the route ``node``: all that it publishes but commands."""

    def __init__(self, node: Node) -> None:
        self._name, self._clock = node.get_fully_qualified_name(), node.get_clock()
        self._steady, self._diagnosed_ns = Clock(clock_type=ClockType.STEADY_TIME), 0
        self._phase_pub = report_publisher(node, String, 'phase', qos.LATCHED)
        self._progress_pub = report_publisher(node, JointState, '~/progress', qos.STREAM)
        self._path_pub = report_publisher(node, Path, '~/path', qos.LATCHED)
        self._markers_pub = report_publisher(node, MarkerArray, '~/markers', qos.LATCHED)
        self._diagnostics_pub = report_publisher(
            node, DiagnosticArray, '/diagnostics', qos.DIAGNOSTICS
        )
        self._settings_pub = report_publisher(node, String, '~/settings', qos.LATCHED)
        self._events_pub = report_publisher(node, String, '~/events', qos.DIAGNOSTICS)

    def route(self, route: Route) -> None:
        """Publish the path and the key views of a route."""
        now_ns = self._clock.now().nanoseconds
        self._path_pub.publish(route_messages.path(route, now_ns))
        self._markers_pub.publish(route_messages.markers(route, now_ns))

    def step(self, step: RouteStep, stamp_ns: int, frame_id: str) -> None:
        """Publish what an image led to."""
        self.progress(step, stamp_ns, frame_id)
        self.standing(step, stamp_ns)

    def progress(self, step: RouteStep, stamp_ns: int, frame_id: str) -> None:
        """Publish what a step tells the base, and how far it is: a replay compares with it."""
        values = route_messages.telemetry(step)
        self._progress_pub.publish(write.telemetry(values, stamp_ns, frame_id))

    def settings(self, groups: Sequence[Settings], after_stamp_ns: int | None) -> None:
        """Publish the settings of a repetition, so that a bag can be replayed with them."""
        text = settings_text.to_text(self._name, groups, after_stamp_ns)
        self._settings_pub.publish(write.text(text))

    def event(self, entry: Entry) -> None:
        """Publish what happened between two images, likewise."""
        self._events_pub.publish(write.text(event_log.to_text(entry)))

    def standing(self, step: RouteStep, stamp_ns: int | None = None) -> None:
        """Publish the phase, and why, also where no image led to it."""
        stamp_ns = self._clock.now().nanoseconds if stamp_ns is None else stamp_ns
        self._phase_pub.publish(write.text(step.phase))
        self._diagnostics_pub.publish(route_messages.diagnosis(step, stamp_ns, name=self._name))
        self._diagnosed_ns = self._steady.now().nanoseconds

    @property
    def silence(self) -> float:
        """Time since the last diagnostics [s], on the steady clock."""
        return seconds_between(self._diagnosed_ns, self._steady.now().nanoseconds)
