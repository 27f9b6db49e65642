"""The dock node: where the photograph was taken, in metres; and docking on request."""

from collections import deque
import sys
from typing import Any

from geometry_msgs.msg import Twist as TwistMessage
from geometry_msgs.msg import TwistStamped
from nav_msgs.msg import Odometry
from rclpy.node import Node
from sensor_msgs.msg import CameraInfo, PointCloud2
from std_srvs.srv import Trigger

from visual_servo_epipolar.core.docking.path import Path, Place
from visual_servo_epipolar.core.docking.search import DockSearch, looked
from visual_servo_epipolar.core.docking.settings import DockPoseSettings
from visual_servo_epipolar.core.docking.sighting import observed
from visual_servo_epipolar.core.docking.task_settings import DockTaskSettings
from visual_servo_epipolar.core.geometry.cameras.calibrated import CalibratedCamera
from visual_servo_epipolar.core.stamps import NOT_ADVANCING
from visual_servo_epipolar.messages import docking, read, validation
from visual_servo_epipolar.messages.docking import DockWire
from visual_servo_epipolar.nodes import parameters, qos
from visual_servo_epipolar.nodes.complaints import Complaints
from visual_servo_epipolar.nodes.docking.reports import DockReports
from visual_servo_epipolar.nodes.docking.reversal import Reversal
from visual_servo_epipolar.nodes.docking.server import DockServer
from visual_servo_epipolar.nodes.docking.settings import DockNodeSettings
from visual_servo_epipolar.nodes.run import spin
from visual_servo_epipolar.nodes.transforms.static_mount import StaticMount

WARN_PERIOD_S = 5.0
MOST_PENDING = 10  # tracks that wait for odometry: more are of a base that is silent
NO_NAV2 = (
    'nav2_msgs cannot be imported, dock_robot is not served; install ros-jazzy-nav2-msgs for it'
)


class DockNode(Node):
    """
    Publishes the dock's pose wherever the photograph is seen, and serves requests to dock.

    ``wire`` is the action type that is served, by default that of nav2_msgs.
    """

    def __init__(self, wire: DockWire | None = None, **options: Any) -> None:
        super().__init__('dock_node', **options)
        self._warn = Complaints(self, WARN_PERIOD_S)
        self._node_settings = parameters.declare(self, DockNodeSettings)
        self._task_settings = parameters.declare(self, DockTaskSettings)
        self._settings = parameters.declare(self, DockPoseSettings)
        parameters.refuse_unknown(self, options)
        parameters.watch(self, lambda: self._task_settings, self._use_task)
        parameters.watch(self, lambda: self._settings, self._use)
        self._camera: CalibratedCamera | None = None
        self._search, self._path, self._path_frame = DockSearch(), Path(), ''
        self._pending: deque[PointCloud2] = deque(maxlen=MOST_PENDING)
        self._stamp_ns: int | None = None
        settings = self._node_settings
        self._mount: StaticMount | None = None
        if settings.mount_from_tf:
            self._mount = StaticMount(self, settings.base_frame, self._warn)
        self._reports = DockReports(self, settings.base_frame)
        self._create_subscriptions()
        self._reversal = self._reversed_commands()
        self._server = self._served(wire)

    def stop(self) -> None:
        """End what moves the robot."""
        if self._server is not None:
            self._server.stop()
        if self._reversal is not None:
            self._reversal.stop()

    def destroy_node(self) -> None:
        """Take the action server away before the node goes."""
        if self._server is not None:
            self._server.destroy()
        super().destroy_node()

    def _create_subscriptions(self) -> None:
        settings = self._node_settings
        info = qos.IMAGES[settings.camera_reliability]
        self.create_subscription(CameraInfo, 'camera_info', self._on_info, info)
        self.create_subscription(PointCloud2, 'tracks', self._on_tracks, qos.STREAM)
        if settings.path_source == 'odometry':
            self.create_subscription(Odometry, 'odom', self._on_odometry, qos.ODOMETRY)
        else:
            kind = TwistStamped if settings.enable_stamped_cmd_vel else TwistMessage
            self.create_subscription(kind, 'cmd_vel', self._on_command, qos.COMMAND)
        self.create_service(Trigger, '~/reset', self._on_reset)

    def _reversed_commands(self) -> Reversal | None:
        settings = self._node_settings
        if not settings.dock_backwards:
            return None
        return Reversal(
            self,
            self._warn,
            stamped=settings.enable_stamped_cmd_vel,
            base_frame=settings.base_frame,
        )

    def _served(self, wire: DockWire | None) -> DockServer | None:
        settings = self._node_settings
        if not settings.serve_action:
            return None
        wire = wire or docking.dock_robot_wire()
        if wire is None:
            self.get_logger().error(NO_NAV2)
            return None
        return DockServer(self, wire, settings.servo, self._task_settings)

    def _use(self, settings: DockPoseSettings) -> None:
        self._settings = settings

    def _use_task(self, settings: DockTaskSettings) -> None:
        self._task_settings = settings
        if self._server is not None:
            self._server.settings = settings

    def _on_info(self, message: CameraInfo) -> None:
        try:
            camera = read.camera(message, rectified=self._node_settings.rectified)
        except ValueError as error:
            self._camera = None
            self._warn(f'camera_info cannot be used: {error}')
            return
        if self._camera is not None and camera != self._camera:
            self._warn('camera_info has changed: the dock is looked for anew')
            self._look_anew()
        self._camera = camera

    def _on_odometry(self, message: Odometry) -> None:
        try:
            self._path.add_pose(read.stamp_ns(message.header), read.pose(message))
        except ValueError as error:
            self._warn(f'odometry refused: {error}')
            return
        self._path_frame = message.header.frame_id
        self._look_at_pending()

    def _on_command(self, message: Any) -> None:
        stamped = self._node_settings.enable_stamped_cmd_vel
        now_ns = int(self.get_clock().now().nanoseconds)
        try:
            twist = read.twist(message)
        except ValueError as error:
            self._warn(f'a command is refused: {error}')
            return
        self._path.add_twist(read.stamp_ns(message.header) if stamped else now_ns, twist)

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
        source = 'odom' if self._node_settings.path_source == 'odometry' else 'cmd_vel'
        if self._camera is None:
            return 'no usable camera_info yet; tracks wait for it'
        if self._path.last_ns is None:
            topic = self.resolve_topic_name(source)
            return f'nothing came on {topic} yet; start what publishes it, or remap {source}'
        return f'no {source} for these tracks: are its stamps those of another clock?'

    def _look_at_pending(self) -> None:
        """Look at the tracks that the path reaches by now."""
        predict = self._node_settings.path_source == 'commands'
        while self._pending and self._camera is not None:
            stamp_ns = read.stamp_ns(self._pending[0].header)
            place = self._path.at(stamp_ns, predict=predict)
            if place is None and (self._path.last_ns is None or stamp_ns > self._path.last_ns):
                return
            message = self._pending.popleft()
            if place is not None:
                self._look(message, self._camera, place)

    def _look(self, message: PointCloud2, camera: CalibratedCamera, place: Place) -> None:
        features, warning = validation.checked_tracks(message, camera)
        if warning:
            self._warn(warning)
        if self._mount is not None and not self._search.keys:  # before anything is seen
            self._settings = self._mount.taken(message.header.frame_id, self._settings)
        ids, observation = observed(features, camera, place.stamp_ns)
        self._search = looked(self._search, ids, observation, place, self._settings)
        if self._search.dock is not None:
            by_path = self._node_settings.pose_frame == 'odometry'
            self._reports.pose(self._search.dock, place, self._path_frame if by_path else None)
        self._reports.search(self._search, place.stamp_ns)

    def _look_anew(self) -> None:
        """Forget the dock, and the mount that /tf_static told: the next may be another."""
        self._search = DockSearch()
        if self._mount is not None:
            self._settings = self._mount.dropped(self._settings)

    def _on_reset(self, request: Trigger.Request, response: Trigger.Response) -> Trigger.Response:
        self._look_anew()
        self._pending.clear()
        response.success, response.message = True, 'the dock is looked for anew'
        return response


def main() -> None:
    """Run the node."""
    sys.exit(spin(DockNode))


if __name__ == '__main__':
    main()
