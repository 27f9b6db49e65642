"""Session: what a run began with, and what interrupts it: orders, and tracks that do not come."""

from dataclasses import dataclass, replace
from enum import Enum

from visual_servo_epipolar.core.cameras.model import CameraModel
from visual_servo_epipolar.core.goal import NO_GOAL
from visual_servo_epipolar.core.laws.command import HALT
from visual_servo_epipolar.core.laws.machine import interruption
from visual_servo_epipolar.core.laws.phase import Event, Phase
from visual_servo_epipolar.core.servo.state import ServoState, ViewState

GOAL_CHANGED = (
    'the photograph has changed in mid-run: its tracks lead to another goal; send the one it '
    'began with, or reset'
)


class Interruption(Enum):
    """
    Interruption of a run between two steps.

    STOPPED: ordered to stop. RESET: a new run. HALTED: a standstill that keeps the state. LOST: no
    tracks came in time, or of another camera. TIMED_OUT: none came while it held.
    """

    STOPPED = 'stopped'
    RESET = 'reset'
    HALTED = 'halted'
    LOST = 'lost'
    TIMED_OUT = 'timed out'


def interrupted(state: ServoState, kind: Interruption, reason: str = '') -> ServoState:
    """Return the state after an interruption, with the command to stand; ``reason`` if any."""
    if kind is Interruption.STOPPED:
        return stop(state)
    if kind is Interruption.RESET:
        return ServoState()
    if kind is Interruption.LOST:
        return lost(state, reason)
    if kind is Interruption.TIMED_OUT:
        return timed_out(state, reason)
    return _halted(state)


def _halted(state: ServoState) -> ServoState:
    """Return ``state`` at a standstill; what was commanded until now has moved the robot."""
    if state.command == HALT:
        return state
    sent = replace(state.motion.sent, withdrawn=True)
    return state.changed(command=HALT, last_linear=state.twist.linear, sent=sent)


def lost(state: ServoState, reason: str) -> ServoState:
    """Return the state after tracks stopped coming: holding where it drove, at a standstill."""
    phase = interruption(state.phase, Event.LOST)
    if phase is None:
        reason = reason if state.phase is Phase.HOLDING else state.reason
        return _halted(state).changed(settled=0, reason=reason)
    # It holds since the last tracks: a phase that had lasted long would count as waiting.
    start_ns = (
        state.run.phase_start_ns if state.measurement is None else state.measurement.stamp_ns
    )
    return _halted(state).changed(phase=phase, phase_start_ns=start_ns, settled=0, reason=reason)


def timed_out(state: ServoState, reason: str) -> ServoState:
    """Return the state of a run that has held for too long: failed; no other changes."""
    phase = interruption(state.phase, Event.TIMED_OUT)
    if phase is None:
        return _halted(state)
    return _halted(state).changed(phase=phase, settled=0, reason=reason)


def stop(state: ServoState) -> ServoState:
    """Return the state after an order to stop: waiting, at a standstill, by the same base."""
    sent = replace(state.motion.sent, withdrawn=True)
    return ServoState().changed(frame=state.view.frame, delay=state.identified.delay, sent=sent)


@dataclass(frozen=True, slots=True)
class Session:
    """
    What a run began with: its ``camera``, None before the first.

    Another may come while a run goes on; it is not its own.
    """

    camera: CameraModel | None = None

    def with_camera(self, camera: CameraModel, state: ServoState) -> 'Session':
        """Return the session where ``camera`` is that of the images: a run keeps its own."""
        if state.phase.runs and self.camera is not None:
            return self
        return replace(self, camera=camera)

    def other_camera(self, camera: CameraModel) -> str:
        """Return in words that ``camera`` is not that of the run; or ''."""
        return '' if camera == self.camera else camera_changed(camera)


def other_goal(state: ServoState, goal: int | None) -> str:
    """Return in words that the features of ``goal`` are not of the goal of a run; or ''."""
    changes = state.phase.runs and state.view.goal.differs(goal or NO_GOAL)
    return GOAL_CHANGED if changes else ''


def change_goal(state: ServoState, goal: int) -> ServoState:
    """
    Return the state that drives to ``goal``, by its id: what was seen of another is forgotten.

    A run keeps the goal that it began with: see ``other_goal``.
    """
    view = state.view
    if goal in (NO_GOAL, view.goal.id) or (state.phase.runs and view.goal.differs(goal)):
        return state
    after = view.goal.followed_by(goal)
    if view.goal.differs(goal):
        view = ViewState(goal=after, period=view.period, frame=view.frame)
        return state.changed(view=view, known=None)
    return state.changed(goal=after)


def camera_changed(camera: CameraModel) -> str:
    """Return in words that a run, begun with another camera, sees through ``camera`` now."""
    return (
        f'camera_info has changed in mid-run, to a {camera.lens} lens of {camera.focal:.1f} px, '
        f'{camera.width}x{camera.height}: the photograph is of another; publish the one it began '
        'with, or reset'
    )
