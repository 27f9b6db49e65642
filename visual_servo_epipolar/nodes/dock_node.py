"""The dock node: where the photograph was taken, in metres; and docking on request."""

from collections.abc import Callable
import sys
from typing import Any

from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus
from geometry_msgs.msg import PoseStamped, PoseWithCovarianceStamped
from rclpy.action import ActionServer, CancelResponse, GoalResponse
from rclpy.qos import QoSProfile
from rclpy.task import Future
from sensor_msgs.msg import CameraInfo, PointCloud2
from std_srvs.srv import Trigger

from visual_servo_epipolar.core.cameras.model import CameraModel
from visual_servo_epipolar.core.docking.pose import DockPoseSettings, DockSearch, update_search
from visual_servo_epipolar.core.docking.task import DockRequest, DockTaskSettings, Error
from visual_servo_epipolar.core.laws.phase import ARMED
from visual_servo_epipolar.core.laws.registry import phase_named
from visual_servo_epipolar.core.odometry.path import PathPlace
from visual_servo_epipolar.core.stamps import AHEAD_S, NANOSECONDS, NOT_ADVANCING
from visual_servo_epipolar.core.twoview.observation import observe
from visual_servo_epipolar.messages import docking, read, validation, write
from visual_servo_epipolar.messages.docking import DockRobotWire
from visual_servo_epipolar.nodes import parameters, qos, steady
from visual_servo_epipolar.nodes.camera_subscriptions import CameraSubscriptions
from visual_servo_epipolar.nodes.driving_inputs import DrivenPath
from visual_servo_epipolar.nodes.frames import StaticMount
from visual_servo_epipolar.nodes.managed import in_every_state, ManagedNode, remedy, serve
from visual_servo_epipolar.nodes.reports import Complaints
from visual_servo_epipolar.nodes.startup.run import spin
from visual_servo_epipolar.nodes.startup.settings import DockNodeSettings

PERIOD_S = 0.1  # of feedback, and of looking at the clock
DEACTIVATED = 'the node was deactivated before it had docked'
SERVO = 'servo_node'
REPORTS = QoSProfile(depth=50)  # a phase may last one image, and others report there as well


class DockServer:
    """
    Serves ``dock_robot`` for ``node`` over a ``wire``; time is that of the steady clock.

    A goal that comes while another is under way supersedes it: the first one is aborted. The
    servo is stopped at every end but that at the dock. Goals are refused while the node is not
    active, in every state: so the server is made once, not each time the node is configured.
    """

    def __init__(
        self, node: ManagedNode, wire: DockRobotWire, settings: Callable[[], DockTaskSettings]
    ) -> None:
        self._node, self._wire, self._settings = node, wire, settings
        self._goal: Any = None
        self._request: DockRequest | None = None
        self._over = Future()
        # Not made by configure: the answer to a start that comes after a cleanup counts as well,
        # and a servo that answers a client that is gone waits in vain.
        self._clients = {
            order: node.create_client(Trigger, f'{SERVO}/{order}') for order in ('start', 'stop')
        }
        self._server = ActionServer(
            node,
            wire.kind,
            'dock_robot',
            execute_callback=self._execute,
            goal_callback=self._accept,
            cancel_callback=lambda goal: CancelResponse.ACCEPT,
        )

    def configure(self) -> None:
        """Listen to the servo, and look at the clock."""
        self._node.create_subscription(DiagnosticArray, '/diagnostics', self._hear, REPORTS)
        self._node.create_timer(PERIOD_S, self._on_tick, clock=steady.STEADY)

    def give_up(self, why: str, *, stops: bool = True) -> None:
        """Abort a goal under way; the servo that drives for it ``stops``."""
        if self._request is not None:
            self._request.end(Error.UNKNOWN, why, stops=stops)
            self._report()

    def destroy(self) -> None:
        """Take the server from the node."""
        self._server.destroy()

    def _accept(self, goal: Any) -> GoalResponse:
        if self._node.is_active:
            return GoalResponse.ACCEPT
        self._node.get_logger().warning(f'dock_robot refused: {remedy(self._node)}')
        return GoalResponse.REJECT

    async def _execute(self, goal: Any) -> Any:
        self.give_up('superseded by another goal', stops=False)  # the new one stops the servo
        over = self._over = Future()
        request = DockRequest(self._order, self._now())
        self._goal, self._request = goal, request
        if self._node.is_active:
            request.accept(*self._wire.request(goal.request), self._settings())
        else:  # any more: the goal was accepted just before
            request.end(Error.UNKNOWN, DEACTIVATED, stops=False)
        self._report()
        outcome = await over  # one thread is enough: nothing blocks while it waits
        if outcome.canceled and goal.is_cancel_requested:
            goal.canceled()
        elif outcome.success:
            goal.succeed()
        else:
            goal.abort()
        return self._wire.result(outcome)

    def _hear(self, message: DiagnosticArray) -> None:
        """Take in phase and reason of the servo, or that it drives as soon as it can."""
        servo = self._node.resolve_service_name(f'{SERVO}/start').rpartition('/')[0]
        if self._request is None or not message.status or message.status[0].name != servo:
            return
        report = read.diagnosis(message)
        word, reason = report.get('phase', ''), report.get('reason', '')
        try:
            phase = None if word == ARMED else phase_named(word)
        except ValueError:
            return  # of another program
        self._request.heard(phase, reason, self._now())
        self._report()

    def _order(self, order: str) -> None:
        """Call the service of an ``order``, in any state of the node; follow its answer."""
        client = self._clients[order]
        if client.service_is_ready():
            future = client.call_async(Trigger.Request())
            future.add_done_callback(lambda answer: self._on_answer(order, answer.result()))
        elif self._request is not None:
            name = self._node.resolve_service_name(client.srv_name)
            refusal = f'service {name} is not available; run the servo, or remap the service'
            self._request.answered(order, refusal, self._now())

    def _on_answer(self, order: str, response: Any) -> None:
        refusal = '' if response.success else f'{order}: {response.message}'
        if self._request is not None:
            self._request.answered(order, refusal, self._now())
            self._report()

    def _on_tick(self) -> None:
        request = self._request
        if request is not None and request.outcome is None:
            if self._goal.is_cancel_requested:
                request.end(Error.NONE, 'canceled', canceled=True)
            request.tick(self._now(), self._settings().servo_timeout)
            self._report()

    def _report(self) -> None:
        """Publish the state of the request under way, or its outcome, once."""
        request = self._request
        if request is None or self._over.done():
            return
        if (outcome := request.outcome) is not None:
            error = f' ({outcome.error.name})' if outcome.error else ''
            self._node.get_logger().info(f'dock_robot: {outcome.message}{error}')
            self._over.set_result(outcome)
        elif self._goal.is_active:
            seconds = max(self._now() - request.began, 0.0)
            self._goal.publish_feedback(self._wire.feedback(request.state, seconds))

    def _now(self) -> float:
        return steady.now_ns() / NANOSECONDS


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
        self._mount = StaticMount(self, '', self._warn, listens=settings.mount_from_tf)
        self._pose_pub = self.create_publisher(PoseStamped, 'detected_dock_pose', qos.STREAM)
        self._covariance_pub = self.create_publisher(
            PoseWithCovarianceStamped, 'detected_dock_pose_with_covariance', qos.STREAM
        )
        self._diagnostics_pub = self.create_publisher(
            DiagnosticArray, '/diagnostics', qos.DIAGNOSTICS
        )
        self._driven = DrivenPath(self, self._warn, ahead=AHEAD_S)
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
            self.get_logger().error(
                'nav2_msgs cannot be imported, dock_robot is not served; install '
                'ros-jazzy-nav2-msgs for it'
            )
            return None
        return DockServer(self, wire, lambda: self._task_settings)

    @in_every_state  # camera_info may be latched
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
            self._look_anew()
        self._stamp_ns = stamp_ns
        place = self._driven.path.at(stamp_ns)
        if self._camera is None:
            self._warn('no usable camera_info yet; tracks need it')
        elif place is None:
            self._warn(self._driven.path.missing(stamp_ns))
        else:
            self._look(message, self._camera, place)

    def _look(self, message: PointCloud2, camera: CameraModel, place: PathPlace) -> None:
        features, warning = validation.checked_tracks(message, camera)
        if warning:
            self._warn(warning)
        frame = self._driven.base_frame or 'base_link'
        if not self._search.views:  # before anything is seen
            self._mount.base_frame = frame
            self._settings = self._mount.taken(message.header.frame_id, self._settings)
            if self._mount.trouble:
                return
        observation = observe(features, camera, place.stamp_ns)
        self._search = update_search(
            self._search, observation, place, self._settings, goal=features.goal
        )
        self._report(self._search, place.stamp_ns, frame)

    def _report(self, search: DockSearch, stamp_ns: int, frame: str) -> None:
        """Publish the pose in the ``frame`` of the base, if it may be, and how far it has come."""
        values: dict[str, object] = {'unpublished_because': search.reason}
        if search.views:
            values['views'] = search.views
        if (dock := search.estimate) is not None:
            values['deviation_m'] = round(dock.deviation, 4)
            values['heading_deviation_rad'] = round(dock.heading_deviation, 5)
        if (dock := search.dock) is not None:
            both = dock.pose, dock.covariance
            self._pose_pub.publish(write.pose_stamped(dock.pose, stamp_ns, frame))
            self._covariance_pub.publish(write.pose_with_covariance(both, stamp_ns, frame))
        status = write.diagnostics(
            self.get_fully_qualified_name(),
            level=DiagnosticStatus.WARN if search.reason else DiagnosticStatus.OK,
            summary=search.reason or 'the dock is seen',
            values=values,
            stamp_ns=stamp_ns,
        )
        self._diagnostics_pub.publish(status)

    def _look_anew(self) -> None:
        """Forget the dock, and the mount from /tf_static: the next may be another."""
        self._search = DockSearch()
        self._settings = self._mount.dropped(self._settings)

    def _on_reset(self) -> str:
        self._look_anew()
        return 'the dock is looked for anew'


if __name__ == '__main__':
    sys.exit(spin(DockNode))
