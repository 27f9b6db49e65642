"""
A request to dock, from acceptance to result: states and errors of the action DockRobot.

Pure functions take the servo's reports and the time [s], and return the task after them with the
orders that follow; a node carries them out. Each attempt stops the servo first: its phases before
``waiting`` belong to an earlier run.
"""

from dataclasses import dataclass, replace
from enum import Enum, IntEnum

from visual_servo_epipolar.core.docking.settings import DockTaskSettings
from visual_servo_epipolar.core.laws.phase import Phase


class State(IntEnum):
    """State of docking, as nav2_msgs/action/DockRobot numbers them in its feedback."""

    NONE = 0
    NAV_TO_STAGING_POSE = 1  # backing off to where the approach can begin
    INITIAL_PERCEPTION = 2
    CONTROLLING = 3
    WAIT_FOR_CHARGE = 4
    RETRY = 5


class Error(IntEnum):
    """Error of docking, as nav2_msgs/action/DockRobot numbers them in its result."""

    NONE = 0
    DOCK_NOT_IN_DB = 901
    DOCK_NOT_VALID = 902
    FAILED_TO_STAGE = 903
    FAILED_TO_DETECT_DOCK = 904
    FAILED_TO_CONTROL = 905
    FAILED_TO_CHARGE = 906
    UNKNOWN = 999


class ServoOrder(Enum):
    """Order to the servo: its service of that name."""

    START = 'start'
    STOP = 'stop'


class Stage(Enum):
    """Stage of an attempt: the servo is being stopped, is being started, drives, charges."""

    CLEARING = 'clearing'
    STARTING = 'starting'
    RUNNING = 'running'
    CHARGING = 'charging'


@dataclass(frozen=True, slots=True)
class Request:
    """Goal of the action: a dock by name, or by a pose that no photograph can serve."""

    by_id: bool = True
    dock_id: str = ''


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
    and ``driven`` are whether the servo reported it in this attempt, ``last_phase`` what it did
    before it ended.
    """

    began: float
    step_began: float
    heard: float
    step: Stage = Stage.CLEARING
    state: State = State.INITIAL_PERCEPTION
    cleared: bool = False
    stopped: bool = False
    armed: bool = False
    driven: bool = False
    last_phase: Phase = Phase.WAITING
    retries: int = 0
    orders: tuple[ServoOrder, ...] = ()
    outcome: Outcome | None = None


def accept_request(request: Request, now: float, settings: DockTaskSettings) -> Task:
    """Return the task of a ``request``, which may end it at once."""
    task = Task(now, now, now)
    if not request.by_id:
        message = (
            'a photograph is docked at, not a pose: set use_dock_id, and dock_id if it has one'
        )
        return _end(task, Error.DOCK_NOT_VALID, message)
    wanted, has = request.dock_id, settings.dock_id
    if wanted and has and wanted != has:
        message = f'the photograph is of dock_id {has!r}, got {wanted!r:.40}'
        return _end(task, Error.DOCK_NOT_IN_DB, message)
    return replace(task, orders=(ServoOrder.STOP,))


def on_answer(task: Task, order: ServoOrder, refusal: str, now: float) -> Task:
    """Return the task after the answer to an ``order``, with the servo's ``refusal`` or ''."""
    task = replace(task, orders=())
    if task.outcome is not None:
        # Orders may overtake each other: a servo that starts after the end is stopped again.
        late = order is ServoOrder.START and not refusal and not task.outcome.success
        return replace(task, orders=(ServoOrder.STOP,)) if late else task
    if refusal:
        return _end(task, Error.UNKNOWN, refusal)
    if order is ServoOrder.STOP and task.step is Stage.CLEARING:
        return _start(replace(task, stopped=True, heard=now), now)
    if order is ServoOrder.START and task.step is Stage.STARTING:
        return replace(task, step=Stage.RUNNING, step_began=now, heard=now)
    return task


def on_phase(
    task: Task, phase: Phase, reason: str, now: float, settings: DockTaskSettings
) -> Task:
    """Return the task after the servo has reported its ``phase``, and the ``reason`` for it."""
    task = replace(task, orders=(), heard=now)
    if task.outcome is not None or task.step is Stage.CHARGING:
        return task
    if task.step is Stage.CLEARING:
        cleared = task.cleared or phase is Phase.WAITING
        return _start(replace(task, cleared=cleared), now)
    if task.step is Stage.STARTING and phase is Phase.WAITING:
        return task
    if phase.drives:
        return _drive(task, phase)
    if phase is Phase.ARRIVED:
        return _arrive(task, now, settings)
    if phase is Phase.FAILED:
        return _retry(task, _error_of(task), reason or 'the servo failed', now, settings)
    if phase is Phase.WAITING and task.driven:
        return _end(task, Error.FAILED_TO_CONTROL, 'somebody else has stopped the servo')
    if phase is Phase.WAITING and task.armed and task.step is Stage.RUNNING:
        why = reason or 'the servo has not begun to drive'
        return _retry(task, Error.FAILED_TO_DETECT_DOCK, why, now, settings)
    return replace(task, last_phase=phase)


def on_armed(task: Task, now: float) -> Task:
    """Return the task after the servo has reported that it is armed."""
    return replace(task, orders=(), heard=now, armed=task.armed or task.step is not Stage.CLEARING)


def on_battery(task: Task, current: float, settings: DockTaskSettings) -> Task:
    """Return the task after the battery takes a ``current`` [A]."""
    task = replace(task, orders=())
    if task.outcome is None and task.step is Stage.CHARGING:
        if current > settings.charging_threshold:
            return replace(task, outcome=Outcome(success=True, message='docked, and charging'))
    return task


def on_tick(task: Task, now: float, settings: DockTaskSettings) -> Task:
    """Return the task as time goes by: what takes too long fails."""
    task = replace(task, orders=())
    if task.outcome is not None:
        return task
    waited = now - task.step_began
    if task.step is Stage.CHARGING:
        if waited > settings.wait_charge_timeout:
            reason = f'no current above {settings.charging_threshold:g} A for {waited:.0f} s'
            return _end(task, Error.FAILED_TO_CHARGE, reason)
        return task
    silence = now - task.heard
    if silence > settings.servo_timeout:
        error = Error.FAILED_TO_CONTROL if task.driven else Error.FAILED_TO_DETECT_DOCK
        return _end(task, error, f'no message of the servo has come for {silence:.1f} s')
    if task.step in (Stage.CLEARING, Stage.STARTING) and waited > settings.servo_timeout:
        reason = f'the servo has not begun anew for {waited:.1f} s; is phase that of this servo?'
        return _end(task, Error.UNKNOWN, reason)
    if task.step is Stage.RUNNING and not task.driven:
        if waited > settings.initial_perception_timeout:
            reason = f'the photograph was not seen for {waited:.0f} s'
            return _retry(task, Error.FAILED_TO_DETECT_DOCK, reason, now, settings)
    if task.step is Stage.RUNNING and waited > settings.dock_approach_timeout:
        reason = f'the approach took longer than {settings.dock_approach_timeout:g} s'
        return _retry(task, Error.FAILED_TO_CONTROL, reason, now, settings)
    return task


def cancel(task: Task) -> Task:
    """Return the task after an order to give it up: the servo is stopped."""
    outcome = Outcome(message='canceled', canceled=True)
    return replace(task, orders=(ServoOrder.STOP,), outcome=outcome)


def abandon(task: Task, why: str) -> Task:
    """Return the task after its server has given it up: an error, and the servo is stopped."""
    return _end(task, Error.UNKNOWN, why)


def _start(task: Task, now: float) -> Task:
    """Return the task with the order to start, as soon as the servo has forgotten the last run."""
    if not (task.cleared and task.stopped):
        return task
    return replace(task, step=Stage.STARTING, step_began=now, orders=(ServoOrder.START,))


def _drive(task: Task, phase: Phase) -> Task:
    backs_off = phase is Phase.RETREATING and not task.retries
    state = State.NAV_TO_STAGING_POSE if backs_off else State.CONTROLLING
    return replace(task, state=state, driven=True, last_phase=phase)


def _arrive(task: Task, now: float, settings: DockTaskSettings) -> Task:
    if settings.wait_for_charge:
        return replace(task, step=Stage.CHARGING, step_began=now, state=State.WAIT_FOR_CHARGE)
    return replace(task, outcome=Outcome(success=True, message='docked'))


def _error_of(task: Task) -> Error:
    """Return the error of a servo that failed, by what it did before."""
    if task.last_phase is Phase.RETREATING:
        return Error.FAILED_TO_STAGE
    if task.last_phase in (Phase.HOLDING, Phase.WAITING):
        return Error.FAILED_TO_DETECT_DOCK
    return Error.FAILED_TO_CONTROL


def _retry(task: Task, error: Error, reason: str, now: float, settings: DockTaskSettings) -> Task:
    """Return the task after an attempt that failed: the next one, or the end."""
    if task.retries >= settings.max_retries:
        return _end(task, error, reason)
    again = Task(task.began, now, now, state=State.RETRY, retries=task.retries + 1)
    return replace(again, orders=(ServoOrder.STOP,))


def _end(task: Task, error: Error, message: str) -> Task:
    return replace(task, orders=(ServoOrder.STOP,), outcome=Outcome(error=error, message=message))


def elapsed(task: Task, now: float) -> float:
    """Return the time since the request [s]."""
    return max(now - task.began, 0.0)
