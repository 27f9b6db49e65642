"""The dock node: where the photograph was taken, in metres; and docking on request."""

from collections import deque
import sys
from typing import Any

from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus
from geometry_msgs.msg import PoseStamped, PoseWithCovarianceStamped
from rclpy.node import Node
from sensor_msgs.msg import CameraInfo, PointCloud2

from visual_servo_epipolar.core.cameras.model import CameraModel
from visual_servo_epipolar.core.docking.pose import DockPoseSettings, DockSearch, update_search
from visual_servo_epipolar.core.docking.task import DockTaskSettings
from visual_servo_epipolar.core.odometry.path import LONGEST_STEP_S, PathPlace
from visual_servo_epipolar.core.stamps import NOT_ADVANCING
from visual_servo_epipolar.core.twoview.observation import observe
from visual_servo_epipolar.messages import docking, read, validation, write
from visual_servo_epipolar.messages.docking import DockRobotWire
from visual_servo_epipolar.nodes import parameters, qos
from visual_servo_epipolar.nodes.dock_server import DEACTIVATED, DockServer
from visual_servo_epipolar.nodes.frames import StaticMount
from visual_servo_epipolar.nodes.lifecycle.gates import serve
from visual_servo_epipolar.nodes.lifecycle.managed_node import ManagedNode
from visual_servo_epipolar.nodes.servoing.driven_path import DrivenPath
from visual_servo_epipolar.nodes.startup.complaints import Complaints
from visual_servo_epipolar.nodes.startup.run import spin
from visual_servo_epipolar.nodes.startup.settings import DockNodeSettings
from visual_servo_epipolar.nodes.tracking.camera_subscriptions import CameraSubscriptions

MOST_PENDING = 10  # tracks that wait for odometry: more are of a base that is silent
USUAL_BASE = 'base_link'  # where odometry names no frame of the base
NO_NAV2 = (
    'nav2_msgs cannot be imported, dock_robot is not served; install ros-jazzy-nav2-msgs for it'
)


class DockReports:
    """Reports of the dock node ``node``."""

    def __init__(self, node: Node) -> None:
        self._name = node.get_fully_qualified_name()
        self._pose_pub = node.create_publisher(PoseStamped, 'detected_dock_pose', qos.STREAM)
        self._covariance_pub = node.create_publisher(
            PoseWithCovarianceStamped, 'detected_dock_pose_with_covariance', qos.STREAM
        )
        self._diagnostics_pub = node.create_publisher(
            DiagnosticArray, '/diagnostics', qos.DIAGNOSTICS
        )

    def search(self, search: DockSearch, stamp_ns: int, frame: str) -> None:
        """Publish the pose in the ``frame`` of the base, if it may be, and how far it has come."""
        values: dict[str, object] = {'unpublished_because': search.reason}
        if search.map is not None:
            values['views'] = len(search.map.window)
        if (dock := search.estimate) is not None:
            values['deviation_m'] = round(dock.deviation, 4)
            values['heading_deviation_rad'] = round(dock.heading_deviation, 5)
        if (dock := search.dock) is not None:
            both = dock.pose, dock.covariance
            self._pose_pub.publish(write.pose_stamped(dock.pose, stamp_ns, frame))
            self._covariance_pub.publish(write.pose_with_covariance(both, stamp_ns, frame))
        self._diagnostics_pub.publish(
            write.diagnostics(
                self._name,
                level=DiagnosticStatus.WARN if search.reason else DiagnosticStatus.OK,
                summary=search.reason or 'the dock is seen',
                values=values,
                stamp_ns=stamp_ns,
            )
        )


class DockNode(ManagedNode):
    """
    Publishes the dock's pose wherever the photograph is seen, and serves requests to dock.

    ``wire`` is the action type that is served, by default that of nav2_msgs. No request outlives
    a deactivation: one under way is aborted, and the servo that drives for it is stopped.
    """

    def __init__(self, wire: DockRobotWire | None = None, **options: Any) -> None:
        super().__init__('dock_node', **options)
        self._warn = Complaints(self)
        self._node_settings = parameters.declare(self, DockNodeSettings)
        self._task_settings = parameters.declare(self, DockTaskSettings)
        self._settings = parameters.declare(self, DockPoseSettings)
        parameters.finish(self, options)
        parameters.watch(self, '_task_settings')
        parameters.watch(self, '_settings')
        self._server = self._new_server(wire)
        serve(self, '~/reset', self._on_reset)
        self.autostart(self._node_settings)

    def configure(self) -> None:
        """Create all that the search for the dock, and docking, need."""
        settings = self._node_settings
        self._camera: CameraModel | None = None
        self._search = DockSearch()
        self._stamp_ns: int | None = None
        self._pending: deque[PointCloud2] = deque(maxlen=MOST_PENDING)
        self._mount = StaticMount(self, '', self._warn, listens=settings.mount_from_tf)
        self._reports = DockReports(self)
        self._driven = DrivenPath(self, self._warn, on_odometry=self._look_at_pending)
        camera = CameraSubscriptions(self, 'raw', settings.camera_reliability)
        camera.create_subscription(CameraInfo, 'camera_info', self._on_info)
        self.create_subscription(PointCloud2, 'tracks', self._on_tracks, qos.STREAM)
        if self._server is not None:
            self._server.configure()

    def activate(self) -> None:
        """Look for the dock anew: the robot may have been driven elsewhere meanwhile."""
        self._look_anew()
        self._driven.begin_anew()
        self._stamp_ns = None

    def deactivate(self) -> None:
        """Stop the servo that drives for a request, which fails."""
        self._give_up(DEACTIVATED)
        self._pending.clear()

    def cleanup(self) -> None:
        """Forget the mount from /tf_static: the next may be another."""
        if self.is_configured:
            self._look_anew()

    def stop(self) -> None:
        """Stop the servo that drives for a request."""
        self._give_up('the node ends')

    def suspend(self) -> None:
        """Stop the servo that drives for a request, before the process sleeps."""
        self._give_up('the node was suspended')

    def destroy_node(self) -> None:
        """Take the action server away before the node goes."""
        server, self._server = self._server, None
        if server is not None:
            server.destroy()
        super().destroy_node()

    def _give_up(self, why: str) -> None:
        if self._server is not None:
            self._server.give_up(why)

    def _new_server(self, wire: DockRobotWire | None) -> DockServer | None:
        if not self._node_settings.serve_action:
            return None
        wire = wire or docking.dock_robot_wire()
        if wire is None:
            self.get_logger().error(NO_NAV2)
            return None
        return DockServer(self, wire, lambda: self._task_settings)

    def _on_info(self, message: CameraInfo) -> None:
        try:
            rectified = self._node_settings.rectified
            camera = read.camera(message, rectified=rectified, cropped=True)
        except ValueError as error:
            self._camera = None
            self._warn(f'camera_info cannot be used: {error}')
            return
        if self._camera is not None and camera != self._camera:
            self._warn('camera_info has changed: the dock is looked for anew')
            self._look_anew()
        self._camera = camera

    def _on_tracks(self, message: PointCloud2) -> None:
        stamp_ns = read.stamp_ns(message.header)
        if self._stamp_ns is not None and stamp_ns <= self._stamp_ns:
            self._warn(NOT_ADVANCING)
            self._pending.clear()
            self._look_anew()
        self._stamp_ns = stamp_ns
        if len(self._pending) == MOST_PENDING:
            self._warn(self._missing)
        self._pending.append(message)
        self._look_at_pending()

    @property
    def _missing(self) -> str:
        """What tracks wait for."""
        if self._camera is None:
            return 'no usable camera_info yet; tracks wait for it'
        return self._driven.path.missing(read.stamp_ns(self._pending[0].header))

    def _look_at_pending(self) -> None:
        """Look at the tracks that the path reaches by now."""
        while self._pending and self._camera is not None:
            stamp_ns = read.stamp_ns(self._pending[0].header)
            place, lag = self._driven.path.at(stamp_ns), self._driven.path.lag(stamp_ns)
            if place is None and lag > 0.0:
                return
            if lag < -LONGEST_STEP_S:
                self._warn(self._missing)
            message = self._pending.popleft()
            if place is not None:
                self._look(message, self._camera, place)

    def _look(self, message: PointCloud2, camera: CameraModel, place: PathPlace) -> None:
        features, warning = validation.checked_tracks(message, camera)
        if warning:
            self._warn(warning)
        frame = self._driven.base_frame or USUAL_BASE
        if self._search.map is None:  # before anything is seen
            self._mount.base_frame = frame
            self._settings = self._mount.taken(message.header.frame_id, self._settings)
            if self._mount.trouble:
                return
        observation = observe(features, camera, place.stamp_ns)
        self._search = update_search(
            self._search, observation, place, self._settings, goal=features.goal
        )
        self._reports.search(self._search, place.stamp_ns, frame)

    def _look_anew(self) -> None:
        """Forget the dock, and the mount from /tf_static: the next may be another."""
        self._search = DockSearch()
        self._settings = self._mount.dropped(self._settings)

    def _on_reset(self) -> str:
        self._look_anew()
        self._pending.clear()
        return 'the dock is looked for anew'


if __name__ == '__main__':
    sys.exit(spin(DockNode))
