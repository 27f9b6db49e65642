"""Reports of the route node: phase, progress, the path as taught; settings, events for bags."""

from nav_msgs.msg import Path
from rclpy.node import Node
from sensor_msgs.msg import JointState
from std_msgs.msg import String
from visualization_msgs.msg import MarkerArray

from visual_servo_epipolar.core.routes.route import Route
from visual_servo_epipolar.core.routes.run import RouteStep
from visual_servo_epipolar.messages import write
from visual_servo_epipolar.messages.routes import route_messages
from visual_servo_epipolar.nodes import qos
from visual_servo_epipolar.nodes.lifecycle.reports import NodeReports


class RouteReports(NodeReports):
    """Reports of the route ``node``: all that it publishes but commands."""

    def __init__(self, node: Node) -> None:
        super().__init__(node)
        self._phase_pub = self._publisher(String, 'phase', qos.LATCHED)
        self._progress_pub = self._publisher(JointState, '~/progress', qos.STREAM)
        self._path_pub = self._publisher(Path, '~/path', qos.LATCHED)
        self._markers_pub = self._publisher(MarkerArray, '~/markers', qos.LATCHED)

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

    def standing(self, step: RouteStep, stamp_ns: int | None = None) -> None:
        """Publish the phase, and why, also where no image led to it."""
        stamp_ns = self._clock.now().nanoseconds if stamp_ns is None else stamp_ns
        self._phase_pub.publish(write.text(step.phase))
        self._diagnose(route_messages.diagnosis(step, stamp_ns, name=self._name))
