"""Run of the servo: its state, its steps at images, and interruptions."""

from collections.abc import Callable
from dataclasses import replace
import math

from rclpy.clock import Clock
from rclpy.node import Node

from visual_servo_epipolar.core.laws.phase import Phase
from visual_servo_epipolar.core.rigs.rig import HALT
from visual_servo_epipolar.core.servo.admission import STILL_S
from visual_servo_epipolar.core.servo.state import ServoState
from visual_servo_epipolar.core.servo.supervisor import Interruption, Session
from visual_servo_epipolar.core.stamps import seconds_between
from visual_servo_epipolar.messages.diagnostics import Words
from visual_servo_epipolar.nodes.servoing.commands import Commands
from visual_servo_epipolar.nodes.servoing.freshness import Freshness
from visual_servo_epipolar.nodes.servoing.reports import Reports

QUIET_S = 1.0  # without any tracks: then silence is what is wrong
WAITS_FOR_END = 'will drive once this is resolved: '  # of what an armed servo lacks
Standstill = Callable[[], tuple[str, bool]]


class Arming:
    """
    Order to start: for how long it holds, on the steady ``clock``, and for which photograph.

    A robot that was started long ago must not drive off when its photograph, its camera or
    its clock comes at last: somebody may drive it by hand by then.
    """

    def __init__(self, clock: Clock) -> None:
        self._clock = clock
        self._ordered_ns, self._timeout = 0, 0.0
        self._goal: int | None = None

    def order(self, timeout: float, goal: int | None) -> None:
        """Note an order that holds for ``timeout`` [s], for the photograph ``goal`` if known."""
        self._ordered_ns = int(self._clock.now().nanoseconds)
        self._timeout, self._goal = timeout, goal

    @property
    def is_for_good(self) -> bool:
        """Whether it holds until a run begins, as with autostart, and for any photograph."""
        return self._timeout == math.inf

    @property
    def has_expired(self) -> bool:
        """Whether the order is too old to drive by."""
        now_ns = int(self._clock.now().nanoseconds)
        return seconds_between(self._ordered_ns, now_ns) > self._timeout

    def contradicted(self, goal: int | None, *, has_photograph: bool) -> str:
        """Return that tracks are not of the photograph that was there at the order; or ''."""
        if self.is_for_good:
            return ''
        if not has_photograph:
            return 'the photograph is gone'
        self._goal = goal if self._goal is None else self._goal
        return 'the photograph has changed' if goal not in (None, self._goal) else ''


class Run:
    """
    Run of the servo ``node``: what happens to its ``session`` is commanded, published and logged.

    It is ``active`` between an order to start and one to stop, and armed until it drives;
    ``lapsed`` says why the last order came to nothing, ``trouble`` what is wrong with the tracks
    that come, also logged by ``warn``; ``notice`` is what else the owner of the robot should know.
    ``standstill`` returns why the robot stands, '' if the state says it, and whether that is
    alarming.
    """

    def __init__(
        self,
        node: Node,
        warn: Callable[[str], None],
        commands: Commands,
        reports: Reports,
        standstill: Standstill,
    ) -> None:
        self._clock, self._logger, self._warn = node.get_clock(), node.get_logger(), warn
        self._commands, self._reports, self._standstill = commands, reports, standstill
        self.session = Session()
        self.freshness = Freshness(self._clock)
        self.arming, self.lapsed = Arming(self.freshness.clock), ''
        self.trouble = self.notice = ''

    @property
    def state(self) -> ServoState:
        """State after the last step."""
        return self.session.state

    @property
    def stamp_ns(self) -> int | None:
        """Stamp of the last tracks that counted."""
        return self.session.stamp_ns

    @property
    def active(self) -> bool:
        """Whether a run goes on, or may begin."""
        return self.session.started

    @active.setter
    def active(self, started: bool) -> None:
        self.session = replace(self.session, started=started)

    @property
    def is_armed(self) -> bool:
        """Whether it was started, and drives as soon as it can."""
        return self.active and self.state.phase is Phase.WAITING

    @property
    def is_armed_for_good(self) -> bool:
        """Whether it drives as soon as it can, however late that is: as with autostart."""
        return self.is_armed and self.arming.is_for_good

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

    def advance(self, session: Session, stamp_ns: int, frame_id: str) -> None:
        """Follow a step: command the base, report, and learn for the next."""
        before = self.state
        self.freshness.step()
        self.follow(session)
        self._commands.answer(before, self.state, stamp_ns)  # no command depends on what follows
        words = Words(self._standstill()[0] if self.is_armed else '', self.is_armed, self.notice)
        self._reports.step(self.state, (stamp_ns, frame_id), words)
        self.session = self.session.update_map()

    def follow(self, session: Session, reason: str = '') -> None:
        """Take over a session, and log what is new of its state; ``reason`` is of an order."""
        before, self.session, state = self.state, session, session.state
        self.freshness.follow(state.phase)
        self._reports.change(before, state, reason or state.reason)
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
        if self.freshness.quiet > QUIET_S:
            return f'no tracks for {self.freshness.quiet:.1f} s{self.clock_note}'
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
        elif self.freshness.quiet <= QUIET_S:
            reason += f', {self.freshness.quiet:.1f} s ago'
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
        words = Words(reason, self.is_armed, self.notice)
        self._reports.standing(self.state, words, alarming=alarming)

    def _halt(self) -> None:
        """Stop a robot that may be moving; the state remembers that it stands."""
        if self.state.command != HALT:
            self.insist()
            self._interrupt(Interruption.HALTED)

    def _interrupt(self, kind: Interruption, reason: str = '') -> None:
        """Follow an interruption, and publish it as an event for replays."""
        self._reports.event(kind.value, self.stamp_ns, reason)
        self.follow(self.session.interrupted(kind, reason), reason or kind.value)
