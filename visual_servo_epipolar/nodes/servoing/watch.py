"""Watch of the servo: on the steady clock it stops a robot whose images stay away, and reports."""

from collections.abc import Callable

from rclpy.node import Node

from visual_servo_epipolar.core.laws.phase import Phase
from visual_servo_epipolar.core.servo.settings import ServoSettings
from visual_servo_epipolar.nodes.servoing.admission import Admission
from visual_servo_epipolar.nodes.servoing.run import Run

WATCH_PERIOD_S, IDLE_PERIOD_S = 0.05, 1.0


class Watch:
    """Watch over the ``run`` of ``node``; it ``sleeps`` where time waits for the servo."""

    def __init__(
        self,
        node: Node,
        run: Run,
        warn: Callable[[str], None],
        settings: Callable[[], ServoSettings],
        admission: Admission,
        *,
        sleeps: bool,
    ) -> None:
        self._node, self._run, self._warn, self._settings = node, run, warn, settings
        self._admission, self._rivals, self._sleeps = admission, admission.rivals, sleeps
        if not sleeps:
            clock = run.freshness.clock
            node.create_timer(WATCH_PERIOD_S, self._on_watch, clock=clock)
            node.create_timer(IDLE_PERIOD_S, self._on_idle, clock=clock)

    @property
    def is_stale(self) -> bool:
        """Whether tracks have stayed away for too long."""
        return not self._sleeps and self._run.freshness.age > self._settings().stale_timeout

    def _on_watch(self) -> None:
        """Stop the robot, keep it standing, and end its run, where images do not."""
        freshness, settings = self._run.freshness, self._settings()
        freshness.clock_stands_still()  # or it would be looked at by images alone
        if self._run.is_armed and self._run.arming.has_expired:
            self._run.expire()
        if self._run.state.phase.drives:
            silent = f'no new tracks for {freshness.age:.2f} s{self._run.clock_note}'
            trouble = silent if self.is_stale else self._admission.withheld()
            if trouble:
                self._run.lose(trouble)
        elif self._run.state.phase is Phase.HOLDING and freshness.idle > settings.stale_timeout:
            self._run.insist()
            if freshness.held > settings.holding_timeout:
                self._run.time_out(settings.holding_timeout, self._admission.withheld())
        elif self._run.commands.repeats:
            self._run.insist()

    def look_around(self) -> None:
        """Let be told who else may command the base."""
        if not self._sleeps:
            self._run.notice = self._rivals.notice()

    def _on_idle(self) -> None:
        """Say who else commands the base, and why the robot stands, where no step does."""
        contested = self._rivals.complaint()
        self.look_around()
        if contested and self._run.active:
            self._warn(contested)
            if self._rivals.has_twin:  # others begin no run beside this one
                self._run.stop(contested)
        if self._run.reports.silence >= 0.5 * IDLE_PERIOD_S:
            self._run.report()
