"""Runs of a route node: a way is recorded on a thread beside the node, and repeated by images."""

from collections import deque
from collections.abc import Callable, Sequence
from concurrent.futures import Future, ThreadPoolExecutor
from pathlib import Path
from typing import Any, TypeVar

from nav_msgs.msg import Path as PathMessage
from rclpy.node import Node
from sensor_msgs.msg import JointState
from std_msgs.msg import String

from visual_servo_epipolar.core.arrays import Image
from visual_servo_epipolar.core.cameras.model import CameraModel
from visual_servo_epipolar.core.errors import InputError, VisualServoError
from visual_servo_epipolar.core.geometry.motion import STANDSTILL
from visual_servo_epipolar.core.laws.phase import Phase
from visual_servo_epipolar.core.rigs.rig import Command, HALT
from visual_servo_epipolar.core.routes.route import Route
from visual_servo_epipolar.core.routes.run import RouteRun, RouteStep
from visual_servo_epipolar.core.routes.settings import FollowSettings, TeachSettings
from visual_servo_epipolar.core.routes.teaching import DrivenImages, MOST_WAITING, Teacher
from visual_servo_epipolar.core.servo.admission import Arrival, Repetition
from visual_servo_epipolar.core.servo.settings import ServoSettings
from visual_servo_epipolar.core.settings import Settings
from visual_servo_epipolar.core.stamps import NANOSECONDS
from visual_servo_epipolar.core.twoview.estimator import Attitude
from visual_servo_epipolar.messages import route_messages, write
from visual_servo_epipolar.messages.route_folder import write_route
from visual_servo_epipolar.nodes import qos
from visual_servo_epipolar.nodes.commands import Commands
from visual_servo_epipolar.nodes.reports import NodeReports
from visual_servo_epipolar.nodes.steady import STEADY
from visual_servo_epipolar.nodes.watching import Freshness, IDLE_PERIOD_S, WATCH_PERIOD_S

ResultT = TypeVar('ResultT')
MOST_UNLEARNT = 300  # images that wait to be learnt from


class RouteRecording:
    """
    Recording of a way by ``camera``, of ``images`` that are placed on the driven path.

    A key view is learnt in half a second, in which images go on to come: they are learnt from one
    after the other, on a thread of their own. Their ``trouble`` says why no route comes of it.
    """

    def __init__(
        self, camera: CameraModel, settings: TeachSettings, mount: Attitude, images: DrivenImages
    ) -> None:
        self.camera, self.images = camera, images
        self._teacher = Teacher(camera, settings, mount)
        self._thread = ThreadPoolExecutor(1, thread_name_prefix='route_recording')
        self._learning: deque[Future[None]] = deque()

    @property
    def key_views(self) -> int:
        """The number of key views so far."""
        return self._teacher.key_views

    @property
    def notes(self) -> list[str]:
        """What odometry bridges, how it differs from the images, and which are left out."""
        return [*self._teacher.notes, *self.images.notes]

    @property
    def behind(self) -> int:
        """The number of images that wait to be learnt from."""
        return sum(not step.done() for step in self._learning)

    def see(self, image: Image, stamp_ns: int) -> None:
        """Take in an image of the way, uint8 of shape (H, W)."""
        self.images.see(image, stamp_ns)
        self.look_at_waiting()
        if self.images.unplaced > MOST_WAITING:
            self.images.finish()

    def look_at_waiting(self) -> None:
        """Learn from the images that the driven path reaches by now."""
        for placed in self.images.placed():
            self._learning.append(self._thread.submit(self._teacher.add, *placed))
            if self.behind > MOST_UNLEARNT:
                self.images.trouble = (
                    f'{MOST_UNLEARNT} images wait to be learnt from; send smaller images or '
                    'fewer, and record the way anew'
                )
        self._collect()

    def station(self) -> None:
        """Mark where the robot stands as a station; raises what is wrong."""
        if self.images.missing:
            raise InputError(self.images.missing)
        self._finished(self._thread.submit(self._teacher.station))

    def finish(self) -> Route:
        """Return the route; raises InputError where none can be learnt."""
        self.images.finish()
        try:
            return self._finished(self._thread.submit(self._teacher.finish))
        finally:
            self.close()

    def close(self) -> None:
        """End the thread; what still waits is not learnt from."""
        self._thread.shutdown(cancel_futures=True)

    def _collect(self) -> None:
        """Take note of what was wrong with images that were learnt from."""
        while self._learning and self._learning[0].done():
            error = self._learning.popleft().exception()
            if error is not None and not self.images.trouble:
                self.images.trouble = str(error)

    def _finished(self, future: 'Future[ResultT]') -> ResultT:
        """Return what a step of the thread returns, after all images before it."""
        try:
            result = future.result()
        except (ValueError, VisualServoError) as error:
            self._collect()
            raise InputError(self.images.trouble or str(error)) from None
        self._collect()
        if self.images.trouble:
            raise InputError(self.images.trouble)
        return result


class RouteRenewal:
    """Renewal of a route in its folder after an arrival, on a thread of its own."""

    def __init__(self, logger: Any) -> None:
        self._logger, self._thread = logger, ThreadPoolExecutor(1, 'route_renewal')
        self._run: RouteRun | None = None
        self._folder, self._writing = Path(), self._thread.submit(lambda: None)

    def follow(self, run: RouteRun, folder: Path) -> None:
        """Watch another run, whose route is in a ``folder``."""
        self._run, self._folder = run, folder

    def begin(self) -> None:
        """Write what the run that is watched has confirmed, once it has arrived."""
        run, self._run = self._run, None
        if run is not None and run.settings.renewals:
            self._writing = self._thread.submit(self._write, run, self._folder)

    def wait(self) -> None:
        """Wait until the folder is written."""
        self._writing.result()

    def _write(self, run: RouteRun, folder: Path) -> None:
        try:
            count = run.confirmed
            if count:
                write_route(run.renewed(), folder)
                self._logger.info(f'{count} key views have photographs of today, in {folder}')
        except VisualServoError as error:
            self._logger.warning(f'no photographs of today are kept: {error}')


STANDS = RouteStep(STANDSTILL, Phase.WAITING.value)


class RouteReports(NodeReports):
    """Reports of the route ``node``: all that it publishes but commands."""

    def __init__(self, node: Node) -> None:
        super().__init__(node)
        self._phase_pub = self._publisher(String, 'phase', qos.LATCHED)
        self._progress_pub = self._publisher(JointState, '~/progress', qos.STREAM)
        self._path_pub = self._publisher(PathMessage, '~/path', qos.LATCHED)

    def route(self, route: Route) -> None:
        """Publish the path of a route."""
        self._path_pub.publish(route_messages.path(route, self._clock.now().nanoseconds))

    def progress(self, step: RouteStep, stamp_ns: int, frame_id: str) -> None:
        """Publish what a step tells the base, and how far it is."""
        values = route_messages.telemetry(step)
        self._progress_pub.publish(write.telemetry(values, stamp_ns, frame_id))

    def standing(self, step: RouteStep, stamp_ns: int | None = None) -> None:
        """Publish the phase, and why, also where no image led to it."""
        stamp_ns = self._clock.now().nanoseconds if stamp_ns is None else stamp_ns
        self._phase_pub.publish(write.text(step.phase))
        self._diagnose(route_messages.diagnosis(step, stamp_ns, name=self._name))


class RouteRepetition:
    """
    Repetition of a route by the base of ``node``: what its run decides is sent and reported.

    ``withheld`` returns why the robot may not drive now, or ''; ``stale_timeout`` after how many
    seconds images count as missing. Where time itself waits for the node (not ``watched``), each
    image is answered.
    """

    def __init__(
        self,
        node: Node,
        commands: Commands,
        reports: RouteReports,
        withheld: Callable[[], str],
        stale_timeout: Callable[[], float],
        *,
        watched: bool,
    ) -> None:
        self._clock, self._logger = node.get_clock(), node.get_logger()
        self._commands, self._reports = commands, reports
        self._withheld, self._stale, self._watched = withheld, stale_timeout, watched
        self.freshness, self._images = Freshness(self._clock), Repetition()
        self.run: RouteRun | None = None
        self.last, self._stamp_ns = STANDS, 0
        self._stepped_ns: int | None = None  # stamp of the last image that a step was taken by
        if watched:
            node.create_timer(WATCH_PERIOD_S, self._on_watch, clock=STEADY)
            node.create_timer(IDLE_PERIOD_S, self._on_idle, clock=STEADY)

    @property
    def is_active(self) -> bool:
        """Whether a run is under way."""
        return self.run is not None and not self.run.ended

    def begin(self, run: RouteRun, settings: Sequence[Settings]) -> None:
        """Let a run begin, by the next image; ``settings`` go out."""
        self.run, self.last, self._of_node = run, run.last, settings[0]
        self.freshness.fresh.start()
        self._reports.settings(settings, self._stepped_ns)
        self._reports.standing(self.last)

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
        self.freshness.fresh.start()
        self._stamp_ns = self._stepped_ns = stamp_ns
        step = run.step(image, stamp_ns)
        took_s = self.freshness.fresh.seconds
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
        self.freshness.fresh.start()  # the watch waits for images, not for us

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
        age_ns = round(self.freshness.fresh.seconds * NANOSECONDS)
        if self.last.phase != Phase.HOLDING.value:
            self._logger.warning(f'{reason}, the robot is stopped')
        at_ns = self._stamp_ns + age_ns
        self._end(self.run.halt(at_ns, reason, unsent=unsent))

    def fail(self, reason: str) -> None:
        """End the run, with a reason."""
        if self.run is not None and not self.run.ended:
            self._end(self.run.fail(reason))

    def stop(self, reason: str) -> None:
        """End what goes on, and tell the base to stand."""
        self.run = None
        self._commands.send(HALT, self._clock.now().nanoseconds)
        self._commands.stopped()
        self.last = RouteStep(STANDSTILL, Phase.WAITING.value, reason)
        self._reports.standing(self.last)

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
        run, age = self.run, self.freshness.fresh.seconds
        if run is None or run.ended:
            if self._commands.repeats:
                self._commands.send(HALT, self._clock.now().nanoseconds)
        elif age > max(run.settings.lost_timeout, self._stale()):
            self.fail(f'no image could be driven by for {age:.1f} s: {self.last.reason}')
        elif self.last.phase == Phase.HOLDING.value and age > self._stale():
            self._commands.send(HALT, self._clock.now().nanoseconds)
        elif self.last.twist != STANDSTILL and age > self._stale():
            self.lose(f'no new images for {age:.2f} s')
        elif self.last.twist != STANDSTILL and self._withheld():
            self.lose(self._withheld())

    def _on_idle(self) -> None:
        """Say how things are, where no image does."""
        if self._reports.silence >= 0.5 * IDLE_PERIOD_S:
            self._reports.standing(self.last)
