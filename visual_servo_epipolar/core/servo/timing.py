"""
Timing: how long a phase and the run have lasted, by the stamps of images.

The clock of the stamps is not ours: it may be set while the robot drives. Where it leaps, the
stamps at which phase and run began are moved along, so that limits count the time that passed,
one usual period, and go on by the new clock.
"""

import math

from visual_servo_epipolar.core.estimate.goal_estimate import usual_step
from visual_servo_epipolar.core.laws.phase import Phase
from visual_servo_epipolar.core.reasons import Reason
from visual_servo_epipolar.core.servo.settings import ServoSettings
from visual_servo_epipolar.core.servo.state import ServoState
from visual_servo_epipolar.core.stamps import (
    MOST_GAP_S,
    NANOSECONDS,
    NOT_ADVANCING,
    seconds_between,
)
from visual_servo_epipolar.core.twoview.measurement import Measurement

HALF_TURNS = 3.0  # at full speed, that no turn in place takes


def time_step(state: ServoState, stamp_ns: int) -> float:
    """Return the time from the last image to ``stamp_ns`` to integrate over [s]."""
    if state.measurement is None:
        return 0.0
    return min(max(seconds_between(state.measurement.stamp_ns, stamp_ns), 0.0), MOST_GAP_S)


def clock_jump(state: ServoState, stamp_ns: int, settings: ServoSettings) -> str:
    """
    Return in words how the stamps leap to ``stamp_ns`` from the last image; empty if they do not.

    They must advance. A driving robot has an image before the last is stale; a standing one may
    have waited for as long as the stamps say.
    """
    if state.measurement is None:
        return ''
    gap = seconds_between(state.measurement.stamp_ns, stamp_ns)
    if gap <= 0.0:
        return NOT_ADVANCING
    if not state.phase.drives or gap <= max(settings.stale_timeout, MOST_GAP_S):
        return ''
    return Reason.STAMPS_LEAPT.of(gap)


def after_clock_jump(state: ServoState, stamp_ns: int) -> ServoState:
    """Return ``state`` by the clock that leapt to ``stamp_ns``: one usual period has passed."""
    if state.measurement is None:
        return state
    passed_ns = round(usual_step(state.view.period) * NANOSECONDS)
    leap_ns = stamp_ns - state.measurement.stamp_ns - passed_ns
    return state.changed(
        phase_start_ns=state.run.phase_start_ns + leap_ns,
        run_start_ns=state.run.run_start_ns + leap_ns,
    )


def has_timed_out(state: ServoState, measurement: Measurement, settings: ServoSettings) -> bool:
    """Return whether the run or the phase has lasted too long; waiting may last for ever."""
    if not state.phase.runs:
        return False
    holding = state.phase is Phase.HOLDING
    run_time = seconds_between(state.run.run_start_ns, measurement.stamp_ns)
    phase_time = seconds_between(state.run.phase_start_ns, measurement.stamp_ns)
    timeout = settings.holding_timeout if holding else phase_timeout(state.phase, settings)
    return run_time > settings.run_timeout or phase_time > timeout


def phase_timeout(phase: Phase, settings: ServoSettings) -> float:
    """
    Return how long a ``phase`` may last [s]: a turn in place that brakes as long as some turns.

    One that takes longer swings about its aim: it looks larger than it is.
    """
    if phase is not Phase.DISPLACING or not settings.options.speed_ramps:
        return settings.phase_timeout
    slowest = settings.max_speed_ratio * settings.max_angular
    half_turn = math.pi / slowest + slowest / settings.max_angular_acceleration
    return min(settings.phase_timeout, HALF_TURNS * half_turn)
