"""A request to dock, from acceptance to result: states and errors of the action DockRobot."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from enum import IntEnum
from typing import Any, ClassVar

from visual_servo_epipolar.core.laws.phase import Phase
from visual_servo_epipolar.core.settings import fixed, internal, Settings


@dataclass(frozen=True, kw_only=True)
class DockTaskSettings(Settings):
    """Settings of the action dock_robot: names as docking_server has them."""

    RENAMED: ClassVar[Mapping[str, str]] = {
        'initial_perception_timeout': 'arming_timeout of servo_node',
        'dock_approach_timeout': 'run_timeout of servo_node',
        'max_retries': 'RetryUntilSuccessful of a behaviour tree',
    }
    GONE: ClassVar[Mapping[str, Any]] = {
        'dock_type': '',
        'wait_for_charge': False,
        'charging_threshold': 0.5,
        'wait_charge_timeout': 5.0,
        'initial_perception_timeout': 5.0,
        'dock_approach_timeout': 300.0,
        'max_retries': 3,
    }

    dock_id: str = fixed('', 'Name of the dock of the photograph; empty: that of every request')
    servo_timeout: float = internal(
        5.0, 'Longest silence of the servo while it should drive [s]', low=0.2, high=600.0
    )


class State(IntEnum):
    """State of docking, as nav2_msgs/action/DockRobot numbers them in its feedback."""

    INITIAL_PERCEPTION = 2
    CONTROLLING = 3


class Error(IntEnum):
    """Error of docking, as nav2_msgs/action/DockRobot numbers them in its result."""

    NONE = 0
    DOCK_NOT_IN_DB = 901
    DOCK_NOT_VALID = 902
    FAILED_TO_DETECT_DOCK = 904
    FAILED_TO_CONTROL = 905
    UNKNOWN = 999


@dataclass(frozen=True, slots=True)
class Outcome:
    """Outcome of a request: docked, canceled, or an ``error`` with a ``message``."""

    success: bool = False
    error: Error = Error.NONE
    message: str = ''
    canceled: bool = False


class DockRequest:
    """
    Request to dock: the servo is stopped, started anew, and followed until it ends.

    ``order`` calls the service of the servo of that name, 'stop' or 'start'. Times [s] are those
    of the steady clock. Phases before ``waiting`` belong to an earlier run of the servo.
    ``driven``: the servo has driven for it. An ``outcome`` is final.
    """

    def __init__(self, order: Callable[[str], None], now: float) -> None:
        self.outcome: Outcome | None = None
        self.driven = False
        self.began = self._waits = self._heard = now
        self._order, self._last = order, Phase.WAITING
        self._stopped = self._cleared = self._starts = self._runs = self._armed = False

    @property
    def state(self) -> State:
        """State of docking: the servo looks for the photograph until it drives."""
        return State.CONTROLLING if self.driven else State.INITIAL_PERCEPTION

    def accept(self, by_id: bool, dock_id: str, settings: DockTaskSettings) -> None:
        """Begin where a photograph of the dock is there, which is asked for by name or by pose."""
        has = settings.dock_id
        if not by_id:
            message = (
                'a photograph is docked at, not a pose: set use_dock_id, and dock_id if it has one'
            )
            self.end(Error.DOCK_NOT_VALID, message)
        elif dock_id and has and dock_id != has:
            message = f'the photograph is of dock_id {has!r}, got {dock_id!r:.40}'
            self.end(Error.DOCK_NOT_IN_DB, message)
        else:
            self._order('stop')

    def answered(self, order: str, refusal: str, now: float) -> None:
        """Take in the answer to an ``order``: the servo's ``refusal``, or ''."""
        if self.outcome is not None:
            # Orders may overtake each other: a servo that starts after the end is stopped again.
            if order == 'start' and not refusal and not self.outcome.success:
                self._order('stop')
        elif refusal:
            self.end(Error.UNKNOWN, refusal)
        elif order == 'start':
            self._runs |= self._starts
            self._heard = now if self._starts else self._heard
        elif not self._starts:
            self._stopped, self._heard = True, now
            self._start(now)

    def heard(self, phase: Phase | None, reason: str, now: float) -> None:
        """Take in a report of the servo: its ``phase`` and why; None while it is armed."""
        self._heard = now
        if self.outcome is not None:
            return
        if phase is None:
            self._armed |= self._starts
        elif not self._starts:
            self._cleared |= phase is Phase.WAITING
            self._start(now)
        elif phase is Phase.ARRIVED:
            self.outcome = Outcome(success=True, message='docked')
        elif phase is Phase.FAILED:
            lost = self._last in (Phase.HOLDING, Phase.WAITING)
            error = Error.FAILED_TO_DETECT_DOCK if lost else Error.FAILED_TO_CONTROL
            self.end(error, reason or 'the servo failed')
        elif phase is Phase.WAITING and not self._runs:
            return  # of before
        elif phase is Phase.WAITING and self.driven:
            self.end(Error.FAILED_TO_CONTROL, 'the servo was stopped from elsewhere')
        elif phase is Phase.WAITING and self._armed:
            why = reason or 'the servo has not begun to drive'
            self.end(Error.FAILED_TO_DETECT_DOCK, why)
        else:
            self.driven, self._last = self.driven or phase.drives, phase

    def tick(self, now: float, timeout: float) -> None:
        """End it where the servo is silent for ``timeout`` [s], or does not begin anew."""
        waited, silence = now - self._waits, now - self._heard
        if silence > timeout:
            unseen = Error.FAILED_TO_CONTROL if self.driven else Error.FAILED_TO_DETECT_DOCK
            self.end(unseen, f'no message of the servo has come for {silence:.1f} s')
        elif waited > timeout and not self._runs:  # the servo itself ends what takes too long
            self.end(
                Error.UNKNOWN,
                f'the servo has not begun anew for {waited:.1f} s; is phase that of this servo?',
            )

    def end(
        self, error: Error, message: str, *, canceled: bool = False, stops: bool = True
    ) -> None:
        """End it by an ``error`` or a cancel, if it has not ended; the servo ``stops``."""
        if self.outcome is None:
            self.outcome = Outcome(error=error, message=message, canceled=canceled)
            if stops:
                self._order('stop')

    def _start(self, now: float) -> None:
        """Start the servo as soon as it has forgotten the last run."""
        if self._cleared and self._stopped:
            self._starts, self._waits = True, now
            self._order('start')
