"""The servo: features in, velocity commands out; what to do about them is decided in the core."""

from dataclasses import replace
import math
import sys
from typing import Any

from sensor_msgs.msg import CameraInfo, PointCloud2

from visual_servo_epipolar.core.errors import InputError
from visual_servo_epipolar.core.laws.phase import Phase
from visual_servo_epipolar.core.servo.settings import ServoSettings
from visual_servo_epipolar.core.servo.state import ServoState
from visual_servo_epipolar.core.stamps import AHEAD_S, NOT_ADVANCING
from visual_servo_epipolar.core.twoview.observation import observe
from visual_servo_epipolar.messages import event_log, read, validation
from visual_servo_epipolar.nodes import parameters, qos
from visual_servo_epipolar.nodes.camera_subscriptions import CameraSubscriptions
from visual_servo_epipolar.nodes.commands import Commands, Head
from visual_servo_epipolar.nodes.driving_inputs import DrivenPath, ServoCamera
from visual_servo_epipolar.nodes.live_run import LiveRun, Reports, WAITS_FOR_END
from visual_servo_epipolar.nodes.managed import in_every_state, ManagedNode, serve
from visual_servo_epipolar.nodes.reports import Complaints
from visual_servo_epipolar.nodes.startup.run import spin
from visual_servo_epipolar.nodes.startup.settings import ServoNodeSettings
from visual_servo_epipolar.nodes.steady import STEADY
from visual_servo_epipolar.nodes.watching import Enable, IDLE_PERIOD_S, StopButton, WATCH_PERIOD_S

MEANWHILE = 'the servo goes by its commands meanwhile'


class ServoNode(ManagedNode):
    """
    Hosts a ``core.servo.run``: one command for each set of tracks in it.

    Outside of runs it is silent.

    A watchdog on the steady clock stops the robot when tracks stay away, or repeat their stamp.
    A node that is activated begins a run as ``autostart`` says, but not after a stop.
    """

    def __init__(self, **options: Any) -> None:
        super().__init__('servo_node', **options)
        self._warn = Complaints(self)
        self._node_settings = parameters.declare(self, ServoNodeSettings)
        self._settings = parameters.declare(self, ServoSettings)
        parameters.finish(self, options)
        parameters.watch(self, '_settings', self._announce)
        parameters.watch(self, '_node_settings', self._announce)
        self._begins = self._settings.autostart  # a run, when it is activated
        self._stop_button = StopButton(self, self._stop)
        serve(self, '~/start', self._on_start, done='{}', refused='not started: {}')
        serve(self, '~/stop', self._on_stop, done='stopped, {}')
        serve(self, '~/reset', self._on_reset, done='reset, {}')
        self.autostart(self._node_settings)

    def configure(self) -> None:
        """Create all that a run needs."""
        self._pending_tracks: PointCloud2 | None = None
        self.received = 0  # sets of tracks
        self._camera = ServoCamera(self, self._node_settings, self._warn)
        # Before tracks: where both have come, the pose is taken first.
        self._driven = DrivenPath(
            self,
            lambda text: self._warn(f'{text}; {MEANWHILE}'),
            listens=self._settings.odometry,
            ahead=AHEAD_S,
            profile=qos.ODOMETRY if self._node_settings.watchdog else qos.STREAM,
        )
        self._head = Head(self, self._settings, self._node_settings, self._warn)
        self._commands = Commands(self, self._node_settings, self._head)
        self._reports = Reports(self, self._node_settings.base_frame)
        self._live = LiveRun(
            self,
            lambda: self._node_settings,
            self._warn,
            (self._commands, self._reports),
            Enable(self, self._node_settings.enable_timeout, self._on_withdrawn),
            self._standstill,
        )
        if self._node_settings.watchdog:
            self.create_timer(WATCH_PERIOD_S, self._on_watch, clock=STEADY)
            self.create_timer(IDLE_PERIOD_S, self._on_idle, clock=STEADY)
        camera = CameraSubscriptions(self, 'raw', self._node_settings.camera_reliability)
        camera.create_subscription(CameraInfo, 'camera_info', self._on_info)
        self.create_subscription(PointCloud2, 'tracks', self._on_tracks, qos.STREAM)

    def activate(self) -> None:
        """Wait for tracks, or for ~/start."""
        self._driven.begin_anew()
        self._head.begin_anew()
        if self._begins:
            self._live.arm()
        self._live.report()
        self._announce()
        drives = 'autostart is true: the robot drives as soon as there are tracks'
        self.get_logger().info(drives if self._live.active else f'the robot {self._not_started}')

    def deactivate(self) -> None:
        """Stop the robot; the run is over, and none goes on by itself."""
        self._begins = self._live.active and self._settings.autostart
        self._live.stop()
        self._live.reset()
        self._live.report()
        self._pending_tracks, self._live.trouble = None, ''
        self._commands.wait()
        self._commands.forget()

    def cleanup(self) -> None:
        """Forget the mount of /tf_static: the next may be another."""
        if self.is_configured:
            self._settings = self._camera.static_mount.dropped(self._settings)

    @property
    def _state(self) -> ServoState:
        return self._live.state

    @property
    def _not_started(self) -> str:
        return f'stands until {self.get_fully_qualified_name()}/start is called'

    def stop(self) -> None:
        """Stop the robot, and wait until the command is acknowledged."""
        self._stop()
        if self.is_configured:
            self._commands.wait()

    suspend = stop  # also before the process sleeps

    def _on_withdrawn(self, reason: str) -> None:
        """Hold a robot that drives, as soon as it is not enabled any more."""
        if self._state.phase.drives:
            self._live.lose(reason)

    def _stop(self, reason: str = '') -> None:
        """Stop the robot, also for when the node is active again."""
        self._begins = False
        if self.is_configured:
            self._pending_tracks = None
            self._live.stop(reason)

    def _announce(self) -> None:
        """Publish the settings in force, so that a bag can be replayed with them."""
        if self.is_configured:
            self._reports.settings((self._node_settings, self._settings), self._live.stamp_ns)

    @in_every_state  # camera_info may be latched
    def _on_info(self, message: CameraInfo) -> None:
        live = self._live
        live.run, trouble = self._camera.hear(message, live.run, self._settings)
        if trouble and self._state.phase.drives:
            self._live.lose(trouble)
        pending, self._pending_tracks = self._pending_tracks, None
        if pending is not None and self._camera.model is not None and not self._is_stale:
            self._drive_by(pending)

    def _on_tracks(self, message: PointCloud2) -> None:
        stamp_ns, live = read.stamp_ns(message.header), self._live
        self.received += 1
        lapsed = self._live.hear(message)
        if lapsed:
            live.lapse(f'{lapsed}; call ~/start again')
        trouble = self._live.refusal(message, self._settings.stale_timeout)
        if trouble:
            live.refuse(trouble)
            return
        if stamp_ns != live.stamp_ns:  # a camera that hangs may repeat its last image for ever
            live.freshness.fresh.start()
        if live.stamp_ns is not None and stamp_ns <= live.stamp_ns:
            self._warn(NOT_ADVANCING)
        other_goal = live.run.other_goal(read.goal(message)) if live.active else ''
        if other_goal and self._state.reason != other_goal:
            live.lose(other_goal)
        if live.active:
            mounted = self._camera.mounted(message.header.frame_id, self._state, self._settings)
            if mounted is not self._settings:
                self._settings = mounted
                self._announce()  # from this stamp on
        live.run = replace(live.run, stamp_ns=stamp_ns)
        self._drive_by(message)

    def _drive_by(self, message: PointCloud2) -> None:
        """Take the step that tracks lead to, where a run goes on or may begin."""
        live, camera, stamp_ns = self._live, self._camera.model, read.stamp_ns(message.header)
        if not live.active:
            live.trouble = ''
            return
        if camera is None:
            self._pending_tracks = message
            live.refuse(self._camera.missing)
            return
        waits = self._state.phase is Phase.WAITING
        mount = self._camera.static_mount
        trouble = self._live.contested() or mount.trouble if waits else ''
        trouble = trouble or self._camera.distrusted(stamp_ns, live.run)
        trouble = trouble or self._head.trouble(stamp_ns)
        if trouble:
            live.refuse(trouble)
            return
        live.trouble = ''
        run = live.run.with_camera(camera)
        features, refused = validation.checked_tracks(message, camera)
        features, foreign = run.admitted(features, read.goal(message), camera)
        unusable = foreign or refused
        if unusable:
            self._warn(unusable)
        seen = self._driven.with_odometry(observe(features, camera, stamp_ns))
        # The mount may have become known since: the rig of these settings, as in a replay.
        observation = self._head.with_joints(seen, self._settings.carrier)
        run = run.decide(
            observation,
            self._settings,
            goal=features.goal,
            since_command=self._commands.age,
            trouble=unusable,
        )
        live.advance(run, stamp_ns, message.header.frame_id)
        self._camera.check(observation)

    @property
    def _is_stale(self) -> bool:
        """Whether tracks have stayed away for too long."""
        is_late = self._live.freshness.fresh.seconds > self._settings.stale_timeout
        return self._node_settings.watchdog and is_late

    def _on_watch(self) -> None:
        """Stop the robot, keep it standing, and end its run, where images do not."""
        live, settings = self._live, self._settings
        freshness = live.freshness
        freshness.clock_stands_still()  # or it would be looked at by images alone
        if live.is_armed and live.arming.has_expired:
            live.expire()
        if self._state.phase.drives:
            silent = f'no new tracks for {freshness.fresh.seconds:.2f} s{live.clock_note}'
            trouble = silent if self._is_stale else self._live.withheld()
            if trouble:
                live.lose(trouble)
        elif freshness.holds.runs and freshness.step.seconds > settings.stale_timeout:
            live.insist()
            if freshness.holds.seconds > settings.holding_timeout:
                live.time_out(settings.holding_timeout, self._live.withheld())
        elif self._commands.repeats:
            live.insist()

    def _on_idle(self) -> None:
        """Report others that command the base, and why the robot stands, where no step does."""
        contested = self._live.contested()
        if contested and self._live.active:
            self._warn(contested)
        if self._reports.silence >= 0.5 * IDLE_PERIOD_S:
            self._live.report()

    def _standstill(self) -> tuple[str, bool]:
        """Return why the robot stands, '' if its state says it, and whether that is alarming."""
        if self._stop_button.pressed:
            return self._stop_button.trouble, True
        if not self._live.active:
            lapsed = self._live.lapsed
            return (f'{lapsed}; ' if lapsed else '') + self._not_started, bool(lapsed)
        if self._state.phase is Phase.HOLDING:
            return self._live.latest_trouble, True
        if self._state.ended:
            return '', False
        lacking = self._lacking
        if lacking:
            return f'{WAITS_FOR_END}{lacking}', True
        return 'drives as soon as the next image comes', False

    @property
    def _lacking(self) -> str:
        """What keeps a servo that was started from driving; or ''."""
        live = self._live
        reason = self._camera.missing or self._head.trouble()
        reason = reason or live.trouble or live.withheld()
        return reason or live.missing(self._settings) or live.unseen(self._settings)

    def _refusal(self) -> str:
        """Return why a run may not begin now; or ''."""
        if self._stop_button.pressed:
            return self._stop_button.trouble
        contested = self._live.contested()
        if contested or not self._node_settings.watchdog or self._live.is_armed_for_good:
            return contested
        missing = (
            self._camera.missing,
            self._head.trouble(),
            self._live.missing(self._settings),
        )
        return '; '.join(filter(None, missing))

    def _on_start(self) -> str:
        """Let a run begin, and return in words when the robot drives."""
        if self._state.phase.runs and not self._live.waits_for_start:
            return 'a run is under way'
        refusal = self._refusal()
        if refusal:
            raise InputError(refusal)
        timeout = self._node_settings.arming_timeout
        if self._live.is_armed_for_good or not self._node_settings.watchdog:
            timeout = math.inf
        if self._state.phase is not Phase.WAITING:
            self._live.reset()
        self._live.arm(timeout, self._live.goal)
        self._reports.event(event_log.STARTED, self._live.stamp_ns)
        self._live.report()
        text = f'armed, {self._standstill()[0]}' if self._lacking else 'started'
        if self._lacking and timeout < math.inf:
            text += f'; the order lapses after {timeout:g} s'
        return text

    @in_every_state  # after a stop the robot stands also when the node is active again
    def _on_stop(self) -> str:
        self.stop()
        return 'the robot stands'

    def _on_reset(self) -> str:
        self._pending_tracks = None
        self._head.begin_anew()
        self._live.reset()
        self._live.active = self._live.active and self._settings.autostart
        if self._live.active:
            self._live.arm()
        self._live.report()
        return 'ready for a new run' + ('' if self._live.active else '; call ~/start')


if __name__ == '__main__':
    sys.exit(spin(ServoNode))
