"""
A request to dock, from acceptance to result: states and errors of the action DockRobot.

Pure functions take the servo's reports and the time [s], and return the task after them with the
orders that follow; a node carries them out. It stops the servo first: phases before ``waiting``
belong to an earlier run.
"""

from collections.abc import Mapping
from dataclasses import dataclass, replace
from enum import Enum, IntEnum
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


class ServoOrder(Enum):
    """Order to the servo: its service of that name."""

    START = 'start'
    STOP = 'stop'


class Stage(Enum):
    """Stage of a task: the servo is being stopped, is being started, drives."""

    CLEARING = 'clearing'
    STARTING = 'starting'
    RUNNING = 'running'


@dataclass(frozen=True, slots=True)
class Outcome:
    """Outcome of a task: docked, canceled, or an ``error`` with a ``message``."""

    success: bool = False
    error: Error = Error.NONE
    message: str = ''
    canceled: bool = False


@dataclass(frozen=True, slots=True)
class Task:
    """
    A request under way; ``orders`` are those of the last event, ``outcome`` ends it.

    Times [s] are those at which it began, the ``step`` began and the servo was heard. ``armed``
    and ``driven`` are whether the servo has reported it, ``last_phase`` what it did before it
    ended.
    """

    began: float
    step_began: float
    heard: float
    step: Stage = Stage.CLEARING
    cleared: bool = False
    stopped: bool = False
    armed: bool = False
    driven: bool = False
    last_phase: Phase = Phase.WAITING
    orders: tuple[ServoOrder, ...] = ()
    outcome: Outcome | None = None

    @property
    def state(self) -> State:
        """State of docking: the servo looks for the photograph until it drives."""
        return State.CONTROLLING if self.driven else State.INITIAL_PERCEPTION


def accept_request(by_id: bool, dock_id: str, now: float, settings: DockTaskSettings) -> Task:
    """Return the task of a request for a dock by its name, or by a pose; it may end at once."""
    task, has = Task(now, now, now), settings.dock_id
    if not by_id:
        message = (
            'a photograph is docked at, not a pose: set use_dock_id, and dock_id if it has one'
        )
        return end(task, Error.DOCK_NOT_VALID, message)
    if dock_id and has and dock_id != has:
        message = f'the photograph is of dock_id {has!r}, got {dock_id!r:.40}'
        return end(task, Error.DOCK_NOT_IN_DB, message)
    return replace(task, orders=(ServoOrder.STOP,))


def on_answer(task: Task, order: ServoOrder, refusal: str, now: float) -> Task:
    """Return the task after the answer to an ``order``, with the servo's ``refusal`` or ''."""
    task = replace(task, orders=())
    if task.outcome is not None:
        # Orders may overtake each other: a servo that starts after the end is stopped again.
        late = order is ServoOrder.START and not refusal and not task.outcome.success
        return replace(task, orders=(ServoOrder.STOP,)) if late else task
    if refusal:
        return end(task, Error.UNKNOWN, refusal)
    if order is ServoOrder.STOP and task.step is Stage.CLEARING:
        return _start(replace(task, stopped=True, heard=now), now)
    if order is ServoOrder.START and task.step is Stage.STARTING:
        return replace(task, step=Stage.RUNNING, step_began=now, heard=now)
    return task


def on_report(task: Task, phase: Phase | None, reason: str, now: float) -> Task:
    """Return the task after a report of the servo: its ``phase`` and why; None while armed."""
    task = replace(task, orders=(), heard=now)
    if task.outcome is not None:
        return task
    if phase is None:
        return replace(task, armed=task.armed or task.step is not Stage.CLEARING)
    if task.step is Stage.CLEARING:
        cleared = task.cleared or phase is Phase.WAITING
        return _start(replace(task, cleared=cleared), now)
    if task.step is Stage.STARTING and phase is Phase.WAITING:
        return task
    if phase.drives:
        return replace(task, driven=True, last_phase=phase)
    if phase is Phase.ARRIVED:
        return replace(task, outcome=Outcome(success=True, message='docked'))
    if phase is Phase.FAILED:
        lost = task.last_phase in (Phase.HOLDING, Phase.WAITING)
        error = Error.FAILED_TO_DETECT_DOCK if lost else Error.FAILED_TO_CONTROL
        return end(task, error, reason or 'the servo failed')
    if phase is Phase.WAITING and task.driven:
        return end(task, Error.FAILED_TO_CONTROL, 'the servo was stopped from elsewhere')
    if phase is Phase.WAITING and task.armed and task.step is Stage.RUNNING:
        why = reason or 'the servo has not begun to drive'
        return end(task, Error.FAILED_TO_DETECT_DOCK, why)
    return replace(task, last_phase=phase)


def on_tick(task: Task, now: float, settings: DockTaskSettings) -> Task:
    """Return the task as time goes by: a servo that is silent, or never begins, ends it."""
    task = replace(task, orders=())
    if task.outcome is not None:
        return task
    waited, silence = now - task.step_began, now - task.heard
    unseen = Error.FAILED_TO_CONTROL if task.driven else Error.FAILED_TO_DETECT_DOCK
    if silence > settings.servo_timeout:
        return end(task, unseen, f'no message of the servo has come for {silence:.1f} s')
    if task.step is Stage.RUNNING or waited <= settings.servo_timeout:
        return task  # the servo itself ends what takes too long
    reason = f'the servo has not begun anew for {waited:.1f} s; is phase that of this servo?'
    return end(task, Error.UNKNOWN, reason)


def end(task: Task, error: Error, message: str, *, canceled: bool = False) -> Task:
    """Return the task after its end by an ``error`` or a cancel: the servo is stopped."""
    outcome = Outcome(error=error, message=message, canceled=canceled)
    return replace(task, orders=(ServoOrder.STOP,), outcome=outcome)


def _start(task: Task, now: float) -> Task:
    """Return the task with the order to start, as soon as the servo has forgotten the last run."""
    if not (task.cleared and task.stopped):
        return task
    return replace(task, step=Stage.STARTING, step_began=now, orders=(ServoOrder.START,))
