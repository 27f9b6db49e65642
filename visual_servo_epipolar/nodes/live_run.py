"""
Live run: the run of a servo on a robot, with the tracks that it takes, its steps, its ends.

What is decided about it is ``core.servo.run``; here it is commanded, published and logged.
"""

from collections.abc import Callable
from dataclasses import replace
import math

from geometry_msgs.msg import PoseWithCovarianceStamped
from rclpy.node import Node
from sensor_msgs.msg import JointState, PointCloud2
from std_msgs.msg import String
from visualization_msgs.msg import MarkerArray

from visual_servo_epipolar.core.laws.phase import Phase
from visual_servo_epipolar.core.rigs.rig import HALT
from visual_servo_epipolar.core.servo.admission import Arrival, STILL_S
from visual_servo_epipolar.core.servo.run import Interruption, Run
from visual_servo_epipolar.core.servo.settings import ServoSettings
from visual_servo_epipolar.core.servo.state import ServoState
from visual_servo_epipolar.core.servo.supervisor import too_few_features
from visual_servo_epipolar.core.servo.telemetry import telemetry
from visual_servo_epipolar.messages import diagnostics, read, write
from visual_servo_epipolar.messages.diagnostics import Words
from visual_servo_epipolar.nodes import qos
from visual_servo_epipolar.nodes.commands import Commands, conflict
from visual_servo_epipolar.nodes.reports import ReplayReports
from visual_servo_epipolar.nodes.startup.settings import ServoNodeSettings
from visual_servo_epipolar.nodes.steady import SILENT_S, Stopwatch
from visual_servo_epipolar.nodes.watching import Enable, Freshness

WAITS_FOR_END = 'will drive once this is resolved: '  # of what an armed servo lacks
Standstill = Callable[[], tuple[str, bool]]


class Reports(ReplayReports):
    """Reports of the servo ``node``: all that it publishes but commands."""

    def __init__(self, node: Node, base_frame: str) -> None:
        super().__init__(node)
        self._base_frame = base_frame
        self._goal_pub = self._publisher(PoseWithCovarianceStamped, 'goal_pose', qos.STREAM)
        self._telemetry_pub = self._publisher(JointState, 'epipoles', qos.STREAM)
        self._phase_pub = self._publisher(String, 'phase', qos.LATCHED)
        self._markers_pub = self._publisher(MarkerArray, '~/markers', qos.STREAM)

    def phase(self, state: ServoState, words: Words) -> None:
        """Publish the phase, or that the servo is armed: it drives as soon as it can."""
        self._phase_pub.publish(write.text(words.phase(state)))

    def step(self, state: ServoState, image: tuple[int, str], words: Words) -> None:
        """Publish all that a step found out, with stamp and frame of its ``image``."""
        stamp_ns, frame_id = image
        self.phase(state, words)
        self._telemetry_pub.publish(write.telemetry(telemetry(state), stamp_ns, frame_id))
        estimate = state.measurement
        if estimate is not None and (goal := estimate.in_base()) is not None:
            self._goal_pub.publish(write.pose_with_covariance(goal, stamp_ns, self._base_frame))
        self._diagnose(diagnostics.diagnosis(state, stamp_ns, name=self._name, words=words))
        self._markers_pub.publish(diagnostics.markers(state, stamp_ns, frame_id))

    def standing(self, state: ServoState, words: Words, *, alarming: bool) -> None:
        """Publish the phase and why the robot stands, where no image led to it."""
        self.phase(state, words)
        now_ns = self._clock.now().nanoseconds
        self._diagnose(
            diagnostics.standing_diagnosis(
                state, words, now_ns, name=self._name, alarming=alarming
            )
        )


class Arming:
    """
    Order to start: for how long it holds, on the steady clock, and for which photograph.

    A robot that was started long ago must not drive off when its photograph, its camera or
    its clock comes at last: somebody may drive it by hand by then.
    """

    def __init__(self) -> None:
        self._ordered, self._timeout = Stopwatch(runs=False), 0.0
        self._goal: int | None = None

    def order(self, timeout: float, goal: int | None) -> None:
        """Note an order that holds for ``timeout`` [s], for the photograph ``goal`` if known."""
        self._ordered.start()
        self._timeout, self._goal = timeout, goal

    @property
    def is_for_good(self) -> bool:
        """Whether it holds until a run begins, as with autostart, and for any photograph."""
        return self._timeout == math.inf

    @property
    def has_expired(self) -> bool:
        """Whether the order is too old to drive by."""
        return self._ordered.seconds > self._timeout

    def contradicted(self, goal: int | None, *, has_photograph: bool) -> str:
        """Return that tracks are not of the photograph that was there at the order; or ''."""
        if self.is_for_good:
            return ''
        if not has_photograph:
            return 'the photograph is gone'
        self._goal = goal if self._goal is None else self._goal
        return 'the photograph has changed' if goal not in (None, self._goal) else ''


class LiveRun:
    """
    Run of the servo ``node``: what happens to its ``run`` is commanded, published and logged.

    It is ``active`` between an order to start and one to stop, and armed until it drives;
    ``lapsed`` says why the last order came to nothing, ``trouble`` what is wrong with the tracks
    that come, also logged by ``warn``. ``standstill`` returns why the robot stands, '' if the
    state says it, and whether that is alarming. ``settings`` returns those of the node in force,
    ``enable`` is the heartbeat. Where time itself waits for the servo (no watchdog), all tracks
    are timely.
    """

    def __init__(
        self,
        node: Node,
        settings: Callable[[], ServoNodeSettings],
        warn: Callable[[str], None],
        outputs: tuple[Commands, Reports],
        enable: Enable,
        standstill: Standstill,
    ) -> None:
        self._clock, self._logger, self._warn = node.get_clock(), node.get_logger(), warn
        self._settings, self._enable, self._standstill = settings, enable, standstill
        self._commands, self._reports = outputs
        self._node, self.run = node, Run()
        self.freshness = Freshness(self._clock)
        self.arming, self.lapsed = Arming(), ''
        self.trouble = ''
        self.goal: int | None = None  # the photograph, by its number, once it was in view
        self._has_photograph: bool | None = None  # by the last tracks, if any came
        self._tracks = PointCloud2()  # these

    @property
    def state(self) -> ServoState:
        """State after the last step."""
        return self.run.state

    @property
    def stamp_ns(self) -> int | None:
        """Stamp of the last tracks that counted."""
        return self.run.stamp_ns

    @property
    def active(self) -> bool:
        """Whether a run goes on, or may begin."""
        return self.run.started

    @active.setter
    def active(self, started: bool) -> None:
        self.run = replace(self.run, started=started)

    @property
    def is_armed(self) -> bool:
        """Whether it was started, and drives as soon as it can."""
        return self.active and self.state.phase is Phase.WAITING

    @property
    def is_armed_for_good(self) -> bool:
        """Whether it drives as soon as it can, however late that is: as with autostart."""
        return self.is_armed and self.arming.is_for_good

    def hear(self, message: PointCloud2) -> str:
        """Take note of tracks; return that they are not of the photograph of the order, or ''."""
        goal, self._has_photograph = read.goal(message), read.has_photograph(message)
        self._tracks = message
        self.freshness.heard.start()
        self.goal = None if not self._has_photograph else self.goal if goal is None else goal
        if not self.is_armed:
            return ''
        return self.arming.contradicted(goal, has_photograph=self._has_photograph)

    def missing(self, settings: ServoSettings) -> str:
        """Return what a start lacks that does not come by itself: images, photograph; or ''."""
        if not self._settings().watchdog:
            return ''
        quiet = self.freshness.heard.seconds
        if self._has_photograph is None:
            return (
                'no tracks have come yet; start camera and tracker, and read in the log of the '
                'tracker what it waits for'
            )
        if quiet > max(SILENT_S, settings.stale_timeout):
            return f'no tracks have come for {quiet:.0f} s; are camera and tracker running?'
        if not self._has_photograph:
            return (
                'the tracker has no photograph; drive the robot to the goal, and call its '
                '~/capture_desired, or name a desired_image'
            )
        return ''

    def unseen(self, settings: ServoSettings) -> str:
        """Return that the last tracks show too little of the photograph to begin with; or ''."""
        count = int(self._tracks.width) * int(self._tracks.height)
        if count >= settings.min_features:  # of which some may not be of the photograph
            try:
                count = len(read.features(self._tracks))
            except ValueError as error:
                return str(error)
        return too_few_features(count, settings) if count < settings.min_features else ''

    def refusal(self, message: PointCloud2, still_timeout: float) -> str:
        """Return why no step is taken by these tracks, or ''; see ``core.servo.run.Run.admit``."""
        if not self._settings().watchdog:
            return ''
        arrival = Arrival(
            read.stamp_ns(message.header),
            self._clock.now().nanoseconds,
            self.freshness.clock_stands_still(),
            read.repeats(message),
            read.back(message),
        )
        self.run, trouble = self.run.admit(
            arrival,
            max_latency=self._settings().max_latency,
            still_timeout=still_timeout,
            withheld=self.withheld(),
        )
        return trouble

    def withheld(self) -> str:
        """Return that the robot may not drive, or that it waits for a new start; or ''."""
        trouble = self._enable.withheld() if self._settings().watchdog else ''
        waits = 'resume is manual: after a hold the robot stands until ~/start is called'
        return trouble or (waits if self.waits_for_start else '')

    @property
    def waits_for_start(self) -> bool:
        """Whether a hold is over only with the next order to start."""
        return self.state.phase is Phase.HOLDING and self._settings().resume == 'manual'

    def contested(self) -> str:
        """Return that another servo commands the same base, so that no run may begin; or ''."""
        return conflict(self._node) if self._settings().watchdog else ''

    def arm(self, timeout: float = math.inf, goal: int | None = None) -> None:
        """Let a run begin within ``timeout`` [s], by the photograph ``goal`` if that is known."""
        self.active, self.lapsed = True, ''
        self.arming.order(timeout, goal)

    def expire(self) -> None:
        """Let an order to start lapse that no run has begun by in time."""
        why = self._standstill()[0].removeprefix(WAITS_FOR_END)
        self.lapse(f'the robot did not begin to drive in time ({why})')

    def lapse(self, why: str) -> None:
        """Let an order to start come to nothing: the robot stands until the next."""
        self.active, self.lapsed = False, f'~/start has expired, {why}'
        self._logger.warning(self.lapsed)
        self.report()

    def advance(self, run: Run, stamp_ns: int, frame_id: str) -> None:
        """Follow a step: command the base, report, and learn for the next."""
        before = self.state
        self.freshness.step.start()
        self.follow(run)
        self._commands.answer(before, self.state, stamp_ns)  # no command depends on what follows
        words = Words(self._standstill()[0] if self.is_armed else '', self.is_armed)
        self._reports.step(self.state, (stamp_ns, frame_id), words)
        self.run = self.run.update_map()

    def follow(self, run: Run) -> None:
        """Take over a run, and log what is new of its state."""
        before, self.run, state = self.state, run, run.state
        self.freshness.follow(state.phase)
        if state.phase is not before.phase and state.reason:
            self._logger.info(f'{before.phase.value} -> {state.phase.value} ({state.reason})')
        if state.run.warning and state.run.warning != before.run.warning:
            self._logger.warning(state.run.warning)  # once: no other may keep it from the log
        if state.identified.odometry.refuted and not before.identified.odometry.refuted:
            self._logger.warning(state.identified.odometry.refuted)

    def refuse(self, trouble: str) -> None:
        """Take no step by tracks: hold a robot that drives, and say why."""
        self.trouble = trouble
        if self.state.phase.drives:
            self.lose(trouble)
            return
        if (
            self.state.phase is Phase.HOLDING and self.state.settling.settled
        ):  # not in a row any more
            self._interrupt(Interruption.LOST, trouble)
        self._warn(trouble)

    def lose(self, reason: str) -> None:
        """Stop a robot that drives, and hold."""
        self._logger.warning(f'{reason}, the robot is stopped')
        self._halt()
        self._interrupt(Interruption.LOST, reason)
        self.report()

    @property
    def latest_trouble(self) -> str:
        """What keeps a robot that holds from going on, by the latest that is known."""
        if self.freshness.heard.seconds > SILENT_S:
            return f'no tracks for {self.freshness.heard.seconds:.1f} s{self.clock_note}'
        return self.trouble or self.state.reason

    @property
    def clock_note(self) -> str:
        """That /clock stands still, as an addition to a reason; or ''."""
        stands_still = self.freshness.clock_stands_still() > STILL_S
        return ', and /clock stands still' if stands_still else ''

    def time_out(self, timeout: float, withheld: str = '') -> None:
        """End a run that holds while no images could end it; ``withheld``: as it was not let."""
        reason = f'tracks lost or untrusted for {timeout:g} s: {self.latest_trouble}'
        if withheld:
            reason = f'held for {timeout:g} s: {withheld}'
        elif self.freshness.heard.seconds <= SILENT_S:
            reason += f', {self.freshness.heard.seconds:.1f} s ago'
        self.insist()
        self._interrupt(Interruption.TIMED_OUT, reason)
        self.report()

    def stop(self, reason: str = '') -> None:
        """End the run, and stand until the next order to start."""
        self.active, self.lapsed = False, ''
        self.insist()
        self._commands.stopped()
        self._interrupt(Interruption.STOPPED, reason)
        self.report()

    def reset(self) -> None:
        """Stand, and be ready for a new run."""
        self.trouble = ''
        if self.state.command != HALT:
            self._commands.stopped()
        self._halt()
        self._interrupt(Interruption.RESET)

    def insist(self) -> None:
        """Tell the base to stand; it may not have heard it before."""
        self._commands.send(HALT, self._clock.now().nanoseconds)

    def report(self) -> None:
        """Publish the phase and why the robot stands, where no image led to it."""
        reason, alarming = self._standstill()
        words = Words(reason, self.is_armed)
        self._reports.standing(self.state, words, alarming=alarming)

    def _halt(self) -> None:
        """Stop a robot that may be moving; the state remembers that it stands."""
        if self.state.command != HALT:
            self.insist()
            self._interrupt(Interruption.HALTED)

    def _interrupt(self, kind: Interruption, reason: str = '') -> None:
        """Follow an interruption, and publish it as an event for replays."""
        self._reports.event(kind.value, self.stamp_ns, reason)
        self.follow(self.run.interrupted(kind, reason))
