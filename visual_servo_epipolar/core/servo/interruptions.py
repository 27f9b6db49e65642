"""Interruptions of the servo from outside: orders, and tracks that do not come."""

from dataclasses import replace
from enum import Enum

from visual_servo_epipolar.core.control.command import HALT
from visual_servo_epipolar.core.servo.phases.table import Event, next_phase
from visual_servo_epipolar.core.servo.state import ServoState


class Interruption(Enum):
    """
    Interruption of a run between two steps.

    STOPPED: ordered to stop. RESET: a new run. HALTED: a standstill that keeps the state. LOST: no
    tracks came in time.
    """

    STOPPED = 'stopped'
    RESET = 'reset'
    HALTED = 'halted'
    LOST = 'lost'


def interrupted(state: ServoState, kind: Interruption, reason: str = '') -> ServoState:
    """Return the state after an interruption, with the command to stand; ``reason`` of LOST."""
    if kind is Interruption.STOPPED:
        return stop(state)
    if kind is Interruption.RESET:
        return ServoState()
    if kind is Interruption.LOST:
        return lost(state, reason)
    return replace(state, command=HALT)


def lost(state: ServoState, reason: str) -> ServoState:
    """Return the state after tracks stopped coming: holding where it drove, at a standstill."""
    phase = next_phase(state.phase, Event.LOST)
    if phase is state.phase:
        return replace(state, command=HALT)
    # It holds since the last tracks: a phase that had lasted long would count as waiting.
    start_ns = state.phase_start_ns if state.measurement is None else state.measurement.stamp_ns
    return replace(
        state, phase=phase, phase_start_ns=start_ns, command=HALT, settled=0, reason=reason
    )


def stop(state: ServoState) -> ServoState:
    """Return the state after an order to stop: waiting, at a standstill."""
    return ServoState(phase=next_phase(state.phase, Event.STOPPED), frame=state.frame)
