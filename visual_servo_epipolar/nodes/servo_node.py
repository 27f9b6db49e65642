"""The servo: features in, velocity commands out; what to do about them is decided in the core."""

import sys
from typing import Any

from diagnostic_msgs.msg import DiagnosticArray
from geometry_msgs.msg import Twist as TwistMessage
from geometry_msgs.msg import TwistStamped
from rclpy.clock import Clock, ClockType
from rclpy.duration import Duration
from rclpy.node import Node
from sensor_msgs.msg import CameraInfo, JointState, PointCloud2
from std_msgs.msg import String
from std_srvs.srv import Trigger
from visualization_msgs.msg import MarkerArray

from visual_servo_epipolar.core.control.command import Command, HALT
from visual_servo_epipolar.core.geometry.cameras.calibrated import CalibratedCamera
from visual_servo_epipolar.core.perception.observation import Observation, observe
from visual_servo_epipolar.core.servo.interruptions import (
    camera_changed,
    GOAL_CHANGED,
    interrupted,
    Interruption,
    RunGoal,
)
from visual_servo_epipolar.core.servo.phases.table import DRIVING
from visual_servo_epipolar.core.servo.settings import ServoSettings
from visual_servo_epipolar.core.servo.state import ServoState
from visual_servo_epipolar.core.servo.step import step
from visual_servo_epipolar.core.servo.telemetry import telemetry
from visual_servo_epipolar.core.stamps import seconds_between
from visual_servo_epipolar.core.tracking.features import Features
from visual_servo_epipolar.messages import (
    diagnostics,
    event_log,
    read,
    settings_text,
    validation,
    write,
)
from visual_servo_epipolar.nodes import parameters, qos
from visual_servo_epipolar.nodes.complaints import Complaints
from visual_servo_epipolar.nodes.run import spin
from visual_servo_epipolar.nodes.servo_camera import ServoCamera
from visual_servo_epipolar.nodes.startup.inputs import NO_TIME
from visual_servo_epipolar.nodes.startup.settings import ServoNodeSettings

WARN_PERIOD_S, STOP_TIMEOUT_S, WATCH_PERIOD_S = 5.0, 0.2, 0.05


class ServoNode(Node):
    """
    Hosts ``core.servo.step``: one command for each set of tracks, none while it is not started.

    A watchdog on the steady clock stops the robot when tracks stay away, or repeat their stamp.
    """

    def __init__(self, **options: Any) -> None:
        super().__init__('servo_node', **options)
        self._warn = Complaints(self, WARN_PERIOD_S)
        self._node_settings = parameters.declare(self, ServoNodeSettings)
        self._settings = parameters.declare(self, ServoSettings)
        parameters.refuse_unknown(self, options)
        parameters.watch(self, lambda: self._settings, self._use)
        self._active, self._state = self._settings.autostart, ServoState()
        self._pending_tracks: PointCloud2 | None = None
        self._fresh_ns: int | None = None
        self._goal = RunGoal()
        self._stamp_ns: int | None = None
        self._camera = ServoCamera(self, self._node_settings, self._warn)
        self._watch_clock = Clock(clock_type=ClockType.STEADY_TIME)
        self._create_publishers()
        self._create_subscriptions()
        if self._node_settings.watchdog:
            self.create_timer(WATCH_PERIOD_S, self._on_watch, clock=self._watch_clock)
        self._phase_pub.publish(write.text(self._state.phase.value))
        self._announce()
        if self._active:
            self._log('autostart is true: the robot drives as soon as there are tracks')
        else:
            self._log(f'the robot stands until {self.get_fully_qualified_name()}/start is called')

    def stop(self) -> None:
        """Stop the robot, and wait until the command is acknowledged."""
        self._active, self._state = False, self._interrupted(Interruption.STOPPED)
        self._command(HALT, self.get_clock().now().nanoseconds)
        self._command_pub.wait_for_all_acked(Duration(seconds=STOP_TIMEOUT_S))

    def _create_publishers(self) -> None:
        stamped = self._node_settings.enable_stamped_cmd_vel
        kind = TwistStamped if stamped else TwistMessage
        self._command_pub = self.create_publisher(kind, 'cmd_vel', qos.COMMAND)
        self._telemetry_pub = self.create_publisher(JointState, 'epipoles', qos.STREAM)
        self._phase_pub = self.create_publisher(String, 'phase', qos.LATCHED)
        self._diagnostics_pub = self.create_publisher(
            DiagnosticArray, '/diagnostics', qos.DIAGNOSTICS
        )
        self._markers_pub = self.create_publisher(MarkerArray, '~/markers', qos.STREAM)
        self._settings_pub = self.create_publisher(String, '~/settings', qos.LATCHED)
        self._events_pub = self.create_publisher(String, '~/events', qos.DIAGNOSTICS)

    def _create_subscriptions(self) -> None:
        info = qos.IMAGES[self._node_settings.camera_reliability]
        self.create_subscription(CameraInfo, 'camera_info', self._on_info, info)
        self.create_subscription(PointCloud2, 'tracks', self._on_tracks, qos.STREAM)
        self.create_service(Trigger, '~/start', self._on_start)
        self.create_service(Trigger, '~/stop', self._on_stop)
        self.create_service(Trigger, '~/reset', self._on_reset)

    def _use(self, settings: ServoSettings) -> None:
        self._settings = settings
        self._announce()

    def _announce(self) -> None:
        """Publish the settings in force, so that a bag can be replayed with them."""
        groups = (self._node_settings, self._settings)
        text = settings_text.to_text(self.get_fully_qualified_name(), groups, self._stamp_ns)
        self._settings_pub.publish(write.text(text))

    def _on_info(self, message: CameraInfo) -> None:
        trouble = self._camera.hear(message, self._state, self._settings)
        if trouble and self._state.phase in DRIVING:
            self._lose(trouble)
        pending, self._pending_tracks = self._pending_tracks, None
        if pending is not None and self._camera.model is not None and not self._is_stale():
            self._on_tracks(pending)

    def _on_tracks(self, message: PointCloud2) -> None:
        stamp_ns = read.stamp_ns(message.header)
        if stamp_ns != self._stamp_ns:  # a camera that hangs may repeat its last image for ever
            self._fresh_ns = self._watch_clock.now().nanoseconds
        if self._stamp_ns is not None and stamp_ns <= self._stamp_ns:
            self._warn(NO_TIME)
        other_goal = self._active and self._goal.is_other(read.goal(message), self._state)
        if other_goal and self._state.reason != GOAL_CHANGED:
            self._lose(GOAL_CHANGED)
        if self._active:
            self._take_mount(message.header.frame_id)  # and so announced from this stamp on
        self._stamp_ns = stamp_ns
        if not self._active:
            return
        if self._camera.model is None:
            self._pending_tracks = message
            self._warn('no usable camera_info yet; tracks wait for it, the robot stands')
            self._halt()
            return
        observation = self._observed(message, self._camera.model)
        self._follow(step(self._state, observation, self._settings))
        self._command(self._state.command, stamp_ns)  # first: nobody drives by what follows
        self._publish(stamp_ns, message.header.frame_id)
        self._camera.check(observation, self._state, self._settings)

    def _observed(self, message: PointCloud2, camera: CalibratedCamera) -> Observation:
        """Return the tracks as ``camera`` sees them, none through another than that of the run."""
        features, warning = validation.checked_tracks(message, camera)
        if self._camera.is_other(camera, self._state):
            features, warning = Features(), camera_changed(camera)
        if self._goal.is_other(read.goal(message), self._state):
            features, warning = Features(), GOAL_CHANGED
        observation = observe(features, camera, read.stamp_ns(message.header))
        warning = warning or validation.left_out(observation, camera)
        if warning:
            self._warn(warning)
        return observation

    def _take_mount(self, frame_id: str) -> None:
        settings = self._camera.mounted(frame_id, self._state, self._settings)
        if settings is not self._settings:
            self._use(settings)

    def _follow(self, state: ServoState) -> None:
        """Take over a new state, and log what is new of it."""
        if state.phase is not self._state.phase:
            self._log(f'{self._state.phase.value} -> {state.phase.value} ({state.reason})')
        if state.warning and state.warning != self._state.warning:
            self.get_logger().warning(state.warning)  # once: no other may keep it from the log
        self._state = state

    def _publish(self, stamp_ns: int, frame_id: str) -> None:
        state = self._state
        self._phase_pub.publish(write.text(state.phase.value))
        self._telemetry_pub.publish(write.telemetry(telemetry(state), stamp_ns, frame_id))
        self._diagnostics_pub.publish(
            diagnostics.diagnosis(state, stamp_ns, name=self.get_fully_qualified_name())
        )
        self._markers_pub.publish(diagnostics.markers(state, stamp_ns, frame_id))

    def _command(self, command: Command, stamp_ns: int) -> None:
        """Publish ``command``: its twist on cmd_vel."""
        if self._node_settings.enable_stamped_cmd_vel:
            frame = self._node_settings.base_frame
            self._command_pub.publish(write.twist_stamped(command.twist, stamp_ns, frame))
        else:
            self._command_pub.publish(write.twist(command.twist))

    def _halt(self) -> None:
        """Stop a robot that may be moving; the state remembers that it stands."""
        if self._state.command != HALT:
            self._state = self._interrupted(Interruption.HALTED)
            self._command(HALT, self.get_clock().now().nanoseconds)

    def _interrupted(self, kind: Interruption, reason: str = '') -> ServoState:
        """Return the state after an interruption, and publish it as an event for replays."""
        entry = event_log.Entry(kind.value, self._stamp_ns, reason)
        self._events_pub.publish(write.text(event_log.to_text(entry)))
        return interrupted(self._state, kind, reason)

    def _on_watch(self) -> None:
        if self._state.phase not in DRIVING or not self._is_stale():
            return
        reason = f'no new tracks for {self._age():.2f} s'
        self._lose(reason)

    def _lose(self, reason: str) -> None:
        """Stop a robot that drives, and hold."""
        self.get_logger().warning(f'{reason}, the robot is stopped')
        self._halt()
        self._follow(self._interrupted(Interruption.LOST, reason))
        self._phase_pub.publish(write.text(self._state.phase.value))

    def _is_stale(self) -> bool:
        return self._node_settings.watchdog and self._age() > self._settings.stale_timeout

    def _age(self) -> float:
        """Return the time since the last new tracks [s]."""
        if self._fresh_ns is None:
            return 0.0
        return seconds_between(self._fresh_ns, self._watch_clock.now().nanoseconds)

    def _on_start(self, request: Trigger.Request, response: Trigger.Response) -> Trigger.Response:
        if self._state.ended:
            self._state = self._interrupted(Interruption.RESET)
        self._active = response.success = True
        entry = event_log.Entry(event_log.STARTED, self._stamp_ns)
        self._events_pub.publish(write.text(event_log.to_text(entry)))
        response.message = 'started' if self._camera.model else 'started; waits for camera_info'
        self._log(response.message)
        return response

    def _on_stop(self, request: Trigger.Request, response: Trigger.Response) -> Trigger.Response:
        self.stop()
        self._phase_pub.publish(write.text(self._state.phase.value))
        response.success, response.message = True, 'the robot stands'
        self._log('stopped, the robot stands')
        return response

    def _on_reset(self, request: Trigger.Request, response: Trigger.Response) -> Trigger.Response:
        self._halt()
        self._state = self._interrupted(Interruption.RESET)
        self._active = self._active and self._settings.autostart
        self._phase_pub.publish(write.text(self._state.phase.value))
        response.success, response.message = True, 'ready for a new run'
        if not self._active:
            response.message += '; call ~/start'
        self._log(f'reset, {response.message}')
        return response

    def _log(self, text: str) -> None:
        self.get_logger().info(text)


def main() -> None:
    """Run the node."""
    sys.exit(spin(ServoNode))


if __name__ == '__main__':
    main()
