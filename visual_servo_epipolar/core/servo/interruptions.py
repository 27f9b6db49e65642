"""What takes the servo out of its course from outside: orders, and silence."""

from dataclasses import replace
from enum import Enum

from visual_servo_epipolar.core.control.command import HALT
from visual_servo_epipolar.core.servo.phases.table import Event, next_phase
from visual_servo_epipolar.core.servo.state import ServoState


class Interruption(Enum):
    """
    Why a servo does not simply go on from its last step.

    STOPPED: told to stop. RESET: a new run. HALTED: the robot was stopped, the state is kept.
    LOST: no tracks came in time.
    """

    STOPPED = 'stopped'
    RESET = 'reset'
    HALTED = 'halted'
    LOST = 'lost'


def interrupted(state: ServoState, kind: Interruption, reason: str = '') -> ServoState:
    """Return the state after an interruption; in all of them the robot stands."""
    if kind is Interruption.STOPPED:
        return stop(state)
    if kind is Interruption.RESET:
        return ServoState()
    if kind is Interruption.LOST:
        return lost(state, reason)
    return replace(state, command=HALT)


def lost(state: ServoState, reason: str) -> ServoState:
    """Return the state of a servo that hears nothing any more: holding, at a standstill."""
    phase = next_phase(state.phase, Event.LOST)
    if phase is state.phase:
        return replace(state, command=HALT)
    return replace(state, phase=phase, command=HALT, settled=0, reason=reason)


def stop(state: ServoState) -> ServoState:
    """Return the state of a servo that was told to stop: waiting, at a standstill."""
    return ServoState(phase=next_phase(state.phase, Event.STOPPED), frame=state.frame)
