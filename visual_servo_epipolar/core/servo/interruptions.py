"""What takes the servo out of its course from outside: orders, and silence."""

from dataclasses import replace
from enum import Enum

from visual_servo_epipolar.core.geometry.motion import STANDSTILL
from visual_servo_epipolar.core.servo.state import ServoState
from visual_servo_epipolar.core.servo.step import lost, stop


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
    return replace(state, twist=STANDSTILL)
