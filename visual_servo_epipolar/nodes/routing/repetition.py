"""Repetition of a route: each image leads to one command, and to reports of it."""

from collections.abc import Callable, Sequence

from nav_msgs.msg import Path
from rclpy.node import Node
from sensor_msgs.msg import JointState
from std_msgs.msg import String
from visualization_msgs.msg import MarkerArray

from visual_servo_epipolar.core.arrays import Image
from visual_servo_epipolar.core.geometry.motion import STANDSTILL
from visual_servo_epipolar.core.rigs.rig import Command, HALT
from visual_servo_epipolar.core.routes.route import Route
from visual_servo_epipolar.core.routes.run import HOLDING, RouteRun, RouteStep, WAITING
from visual_servo_epipolar.core.routes.settings import FollowSettings
from visual_servo_epipolar.core.servo.admission import Arrival, Repetition
from visual_servo_epipolar.core.servo.settings import ServoSettings
from visual_servo_epipolar.core.settings import Settings
from visual_servo_epipolar.core.stamps import NANOSECONDS
from visual_servo_epipolar.messages import route_messages, write
from visual_servo_epipolar.messages.event_log import FAILED, HELD, STARTED, STOPPED, UNSENT
from visual_servo_epipolar.nodes import qos
from visual_servo_epipolar.nodes.lifecycle.reports import NodeReports
from visual_servo_epipolar.nodes.servoing.commands import Commands
from visual_servo_epipolar.nodes.servoing.freshness import Freshness, IDLE_PERIOD_S, WATCH_PERIOD_S

STANDS = RouteStep(STANDSTILL, WAITING)


class RouteReports(NodeReports):
    """Reports of the route ``node``: all that it publishes but commands."""

    def __init__(self, node: Node) -> None:
        super().__init__(node)
        self.notice = ''  # what the owner of the robot should know beside
        self._phase_pub = self._publisher(String, 'phase', qos.LATCHED)
        self._progress_pub = self._publisher(JointState, '~/progress', qos.STREAM)
        self._path_pub = self._publisher(Path, '~/path', qos.LATCHED)
        self._markers_pub = self._publisher(MarkerArray, '~/markers', qos.LATCHED)

    def route(self, route: Route) -> None:
        """Publish the path and the key views of a route."""
        now_ns = self._clock.now().nanoseconds
        self._path_pub.publish(route_messages.path(route, now_ns))
        self._markers_pub.publish(route_messages.markers(route, now_ns))

    def progress(self, step: RouteStep, stamp_ns: int, frame_id: str) -> None:
        """Publish what a step tells the base, and how far it is: a replay compares with it."""
        values = route_messages.telemetry(step)
        self._progress_pub.publish(write.telemetry(values, stamp_ns, frame_id))

    def standing(self, step: RouteStep, stamp_ns: int | None = None) -> None:
        """Publish the phase, and why, also where no image led to it."""
        stamp_ns = self._clock.now().nanoseconds if stamp_ns is None else stamp_ns
        self._phase_pub.publish(write.text(step.phase))
        self._diagnose(
            route_messages.diagnosis(step, stamp_ns, name=self._name, notice=self.notice)
        )


class RouteRepetition:
    """
    Repetition of a route by the base of ``node``: what its run decides is sent and reported.

    ``withheld`` returns why the robot may not drive now, or ''; ``notice`` what its owner
    should know beside; ``stale_timeout`` after how many seconds images count as missing. Where
    time itself waits for the node (not ``watched``), each image is answered.
    """

    def __init__(
        self,
        node: Node,
        commands: Commands,
        reports: RouteReports,
        withheld: Callable[[], str],
        notice: Callable[[], str],
        stale_timeout: Callable[[], float],
        *,
        watched: bool,
    ) -> None:
        self._clock, self._logger = node.get_clock(), node.get_logger()
        self._commands, self._reports = commands, reports
        self._withheld, self._stale, self._watched = withheld, stale_timeout, watched
        self._notice = notice
        self.freshness, self._images = Freshness(self._clock), Repetition()
        self.run: RouteRun | None = None
        self.last, self._stamp_ns = STANDS, 0
        self._stepped_ns: int | None = None  # stamp of the last image that a step was taken by
        if watched:
            node.create_timer(WATCH_PERIOD_S, self._on_watch, clock=self.freshness.clock)
            node.create_timer(IDLE_PERIOD_S, self._on_idle, clock=self.freshness.clock)

    @property
    def is_active(self) -> bool:
        """Whether a run is under way."""
        return self.run is not None and not self.run.ended

    def begin(self, run: RouteRun, settings: Sequence[Settings], route: str) -> None:
        """Let a run begin, by the next image; ``settings`` and hash of its ``route`` go out."""
        self.run, self.last, self._of_node = run, run.last, settings[0]
        self.freshness.renew()
        self._reports.settings(settings, self._stepped_ns)
        self._note(STARTED, route)
        self._reports.standing(self.last)

    def look_around(self) -> str:
        """Return what the owner of the robot should know, which diagnostics say from now on."""
        self._reports.notice = self._notice() if self._watched else ''
        return self._reports.notice

    def use(self, follow: FollowSettings, servo: ServoSettings) -> None:
        """Let a run that is under way go on by other settings, from the next image on."""
        if self.run is not None and not self.run.ended:
            self.run.use(follow, servo)
            self._reports.settings((self._of_node, self.run.settings, servo), self._stepped_ns)

    def see(self, image: Image, stamp_ns: int, frame_id: str, max_latency: float) -> None:
        """Take the step that an image leads to, where a run is under way."""
        self._images.see(image)
        run = self.run
        if run is None or run.ended:
            if not self._watched:
                self._commands.send(HALT, stamp_ns)
            return
        trouble = self._refusal(run, stamp_ns, max_latency) if self._watched else ''
        if trouble:
            self.lose(trouble)
            return
        self.freshness.renew()
        self._stamp_ns = self._stepped_ns = stamp_ns
        step = run.step(image, stamp_ns)
        took_s = self.freshness.age
        if self._watched and step.twist != STANDSTILL and took_s > self._stale():
            self._reports.progress(step, stamp_ns, frame_id)
            self.lose(
                f'the step by an image took {took_s:.2f} s, too long to drive by it', unsent=True
            )
        else:
            self._commands.send(Command(step.twist), stamp_ns)  # what follows may take its time
            self._follow(step)
            self._reports.progress(step, stamp_ns, frame_id)
            self._reports.standing(step, stamp_ns)
        run.prepare()
        self.freshness.renew()  # the watch waits for images, not for us

    def _refusal(self, run: RouteRun, stamp_ns: int, max_latency: float) -> str:
        arrival = Arrival(
            stamp_ns,
            self._clock.now().nanoseconds,
            self.freshness.clock_stands_still(),
            self._images.count,
            self._images.back,
        )
        return run.admit(
            arrival,
            max_latency=max_latency,
            still_timeout=self._stale(),
            withheld=self._withheld(),
        )

    def lose(self, reason: str, *, unsent: bool = False) -> None:
        """
        Stop the robot, as no image may be driven by; the next good one goes on.

        The last step was ``unsent`` where it was not sent to the base.
        """
        if self.run is None or self.run.ended:
            return
        self._commands.send(HALT, self._clock.now().nanoseconds)
        age_ns = round(self.freshness.age * NANOSECONDS)
        if self.last.phase != HOLDING:
            self._logger.warning(f'{reason}, the robot is stopped')
        at_ns = self._stamp_ns + age_ns
        self._note(UNSENT if unsent else HELD, reason, at_ns)
        self._end(self.run.halt(at_ns, reason, unsent=unsent))

    def fail(self, reason: str) -> None:
        """End the run, with a reason."""
        if self.run is not None and not self.run.ended:
            self._note(FAILED, reason)
            self._end(self.run.fail(reason))

    def stop(self, reason: str) -> bool:
        """End what goes on, and tell the base to stand; return whether a run was under way."""
        was_active, self.run = self.is_active, None
        if was_active:
            self._note(STOPPED, reason)
        self._commands.send(HALT, self._clock.now().nanoseconds)
        self._commands.stopped()
        self.last = RouteStep(STANDSTILL, WAITING, reason)
        self._reports.standing(self.last)
        return was_active

    def wait(self) -> None:
        """Wait until the last command is acknowledged."""
        self._commands.wait()

    def _note(self, event: str, reason: str, at_ns: int | None = None) -> None:
        """Tell what happened between two images, for bags."""
        self._reports.event(event, self._stepped_ns, reason, at_ns)

    def _end(self, step: RouteStep) -> None:
        self._follow(step)
        self._reports.standing(step)

    def _follow(self, step: RouteStep) -> None:
        """Log what is new of a step; after the end the order to stand is repeated for a while."""
        before, self.last = self.last, step
        if step.phase != before.phase:
            why = f' ({step.reason})' if step.reason else ''
            self._logger.info(f'{before.phase} -> {step.phase}{why}')
        if self.run is not None and self.run.ended:
            self._commands.send(HALT, self._clock.now().nanoseconds)
            self._commands.stopped()

    def _on_watch(self) -> None:
        """Stop the robot where images stay away or it may not drive, and keep it standing."""
        self.freshness.clock_stands_still()
        run, age = self.run, self.freshness.age
        if run is None or run.ended:
            if self._commands.repeats:
                self._commands.send(HALT, self._clock.now().nanoseconds)
        elif age > max(run.settings.lost_timeout, self._stale()):
            self.fail(f'no image could be driven by for {age:.1f} s: {self.last.reason}')
        elif self.last.phase == HOLDING and age > self._stale():
            self._commands.send(HALT, self._clock.now().nanoseconds)
        elif self.last.twist != STANDSTILL and age > self._stale():
            self.lose(f'no new images for {age:.2f} s')
        elif self.last.twist != STANDSTILL and self._withheld():
            self.lose(self._withheld())

    def _on_idle(self) -> None:
        """Say how things are, where no image does."""
        self.look_around()
        if self._reports.silence >= 0.5 * IDLE_PERIOD_S:
            self._reports.standing(self.last)
