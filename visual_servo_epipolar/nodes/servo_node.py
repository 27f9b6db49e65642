"""The servo: features in, velocity commands out; what to do about them is decided in the core."""

import sys
from typing import Any

from sensor_msgs.msg import CameraInfo, PointCloud2
from std_srvs.srv import Trigger

from visual_servo_epipolar.core.control.command import HALT
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
from visual_servo_epipolar.core.tracking.features import Features
from visual_servo_epipolar.messages import event_log, read, validation
from visual_servo_epipolar.nodes import parameters, qos
from visual_servo_epipolar.nodes.complaints import Complaints
from visual_servo_epipolar.nodes.lifecycle.gates import in_every_state
from visual_servo_epipolar.nodes.lifecycle.managed_node import ManagedNode
from visual_servo_epipolar.nodes.run import spin
from visual_servo_epipolar.nodes.servoing.camera import ServoCamera
from visual_servo_epipolar.nodes.servoing.commands import Commands
from visual_servo_epipolar.nodes.servoing.freshness import Freshness
from visual_servo_epipolar.nodes.servoing.reports import Reports
from visual_servo_epipolar.nodes.startup.inputs import NO_TIME
from visual_servo_epipolar.nodes.startup.settings import ServoNodeSettings

WARN_PERIOD_S, WATCH_PERIOD_S = 5.0, 0.05


class ServoNode(ManagedNode):
    """
    Hosts ``core.servo.step``: one command for each set of tracks, none while it is not started.

    A watchdog on the steady clock stops the robot when tracks stay away, or repeat their stamp.
    A node that is activated begins a new run as ``autostart`` says, but after ~/stop.
    """

    def __init__(self, **options: Any) -> None:
        super().__init__('servo_node', **options)
        self._warn = Complaints(self, WARN_PERIOD_S)
        self._node_settings = parameters.declare(self, ServoNodeSettings)
        self._settings = parameters.declare(self, ServoSettings)
        parameters.refuse_unknown(self, options)
        parameters.watch(self, lambda: self._settings, self._use)
        self._active, self._state = self._settings.autostart, ServoState()
        self._create_services()
        self.autostart(self._node_settings)

    def configure(self) -> None:
        """Create all that a run needs."""
        self._pending_tracks: PointCloud2 | None = None
        self._goal = RunGoal()
        self._stamp_ns: int | None = None
        self.received = 0  # sets of tracks
        self._camera = ServoCamera(self, self._node_settings, self._warn)
        self._freshness = Freshness()
        self._commands, self._reports = Commands(self, self._node_settings), Reports(self)
        self._create_subscriptions()
        if self._node_settings.watchdog:
            self.create_timer(WATCH_PERIOD_S, self._on_watch, clock=self._freshness.clock)

    def activate(self) -> None:
        """Wait for tracks, or for ~/start."""
        self._reports.phase(self._state)
        self._announce()
        if self._active:
            self._log('autostart is true: the robot drives as soon as there are tracks')
        else:
            self._log(f'the robot stands until {self.get_fully_qualified_name()}/start is called')

    def deactivate(self) -> None:
        """Stop the robot first; the run is over."""
        self._commands.send(HALT, self.get_clock().now().nanoseconds)
        self._state = self._interrupted(Interruption.RESET)
        self._active = self._active and self._settings.autostart
        self._pending_tracks = None
        self._reports.phase(self._state)
        self._commands.wait()

    def stop(self) -> None:
        """Stop the robot, and wait until the command is acknowledged."""
        self._active = False
        if not self.is_configured:  # it stands
            return
        self._state = self._interrupted(Interruption.STOPPED)
        self._commands.send(HALT, self.get_clock().now().nanoseconds)
        self._commands.wait()

    def _create_subscriptions(self) -> None:
        info = qos.IMAGES[self._node_settings.camera_reliability]
        self.create_subscription(CameraInfo, 'camera_info', self._on_info, info)
        self.create_subscription(PointCloud2, 'tracks', self._on_tracks, qos.STREAM)

    def _create_services(self) -> None:
        self.create_service(Trigger, '~/start', self._on_start)
        self.create_service(Trigger, '~/stop', self._on_stop)
        self.create_service(Trigger, '~/reset', self._on_reset)

    def _use(self, settings: ServoSettings) -> None:
        self._settings = settings
        if self.is_configured:
            self._announce()

    def _announce(self) -> None:
        """Publish the settings in force, so that a bag can be replayed with them."""
        self._reports.settings((self._node_settings, self._settings), self._stamp_ns)

    def _on_info(self, message: CameraInfo) -> None:
        trouble = self._camera.hear(message, self._state, self._settings)
        if trouble and self._state.phase in DRIVING:
            self._lose(trouble)
        pending, self._pending_tracks = self._pending_tracks, None
        if pending is not None and self._camera.model is not None and not self._is_stale():
            self._on_tracks(pending)

    def _on_tracks(self, message: PointCloud2) -> None:
        stamp_ns = read.stamp_ns(message.header)
        self.received += 1
        if stamp_ns != self._stamp_ns:  # a camera that hangs may repeat its last image for ever
            self._freshness.renew()
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
        self._commands.send(self._state.command, stamp_ns)  # nobody drives by what follows
        self._reports.step(self._state, stamp_ns, message.header.frame_id)
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

    def _halt(self) -> None:
        """Stop a robot that may be moving; the state remembers that it stands."""
        if self._state.command != HALT:
            self._state = self._interrupted(Interruption.HALTED)
            self._commands.send(HALT, self.get_clock().now().nanoseconds)

    def _interrupted(self, kind: Interruption, reason: str = '') -> ServoState:
        """Return the state after an interruption, and publish it as an event for replays."""
        self._reports.event(kind.value, self._stamp_ns, reason)
        return interrupted(self._state, kind, reason)

    def _on_watch(self) -> None:
        if self._state.phase not in DRIVING or not self._is_stale():
            return
        self._lose(f'no new tracks for {self._freshness.age:.2f} s')

    def _lose(self, reason: str) -> None:
        """Stop a robot that drives, and hold."""
        self.get_logger().warning(f'{reason}, the robot is stopped')
        self._halt()
        self._follow(self._interrupted(Interruption.LOST, reason))
        self._reports.phase(self._state)

    def _is_stale(self) -> bool:
        late = self._freshness.age > self._settings.stale_timeout
        return self._node_settings.watchdog and late

    def _on_start(self, request: Trigger.Request, response: Trigger.Response) -> Trigger.Response:
        if self._state.ended:
            self._state = self._interrupted(Interruption.RESET)
        self._active = response.success = True
        self._reports.event(event_log.STARTED, self._stamp_ns)
        response.message = 'started' if self._camera.model else 'started; waits for camera_info'
        self._log(response.message)
        return response

    @in_every_state  # who stops the robot wants it to stand also when the node is active again
    def _on_stop(self, request: Trigger.Request, response: Trigger.Response) -> Trigger.Response:
        self.stop()
        if self.is_configured:
            self._reports.phase(self._state)
        response.success, response.message = True, 'the robot stands'
        self._log('stopped, the robot stands')
        return response

    def _on_reset(self, request: Trigger.Request, response: Trigger.Response) -> Trigger.Response:
        self._halt()
        self._state = self._interrupted(Interruption.RESET)
        self._active = self._active and self._settings.autostart
        self._reports.phase(self._state)
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
