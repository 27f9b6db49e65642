"""Settling: frames in a row that fulfil the aim of a phase, and what they show on average."""

import math

from visual_servo_epipolar.core.geometry.wall import aside
from visual_servo_epipolar.core.laws.decisions import is_close, is_settled
from visual_servo_epipolar.core.laws.phase import Phase
from visual_servo_epipolar.core.laws.phases.arrival import is_in_doubt
from visual_servo_epipolar.core.perception.measurement import Measurement
from visual_servo_epipolar.core.perception.perceive import Perception
from visual_servo_epipolar.core.servo.settings import ServoSettings
from visual_servo_epipolar.core.servo.state import ServoState
from visual_servo_epipolar.core.stamps import seconds_between


def settle(
    state: ServoState,
    perception: Perception,
    previous: Measurement | None,
    dt: float,
    settings: ServoSettings,
) -> ServoState:
    """Return the state with its count of settled frames, ``dt`` [s] after the ``previous``."""
    if is_close(state, settings):
        state = state.changed(time_in_tolerance=state.settling.time_in_tolerance + dt)
    measurement = state.measurement or perception.measurement
    if not is_settled(state, settings):
        return state.changed(settled=0) if state.settling.settled else state
    if state.phase is Phase.HOLDING and not _follows(measurement, previous, settings):
        state = state.changed(settled=0)
    settled = state.settling.settled + 1
    mean = state.settling.settled_parallax if state.settling.settled else 0.0
    square = mean**2 + (measurement.parallax**2 - mean**2) / settled
    return state.changed(
        settled=settled,
        settled_parallax=math.sqrt(max(square, 0.0)),
        settled_aside=_aside(state, measurement, perception, settings),
    )


def _aside(
    state: ServoState, measurement: Measurement, perception: Perception, settings: ServoSettings
) -> float:
    """Return the mean by which settled frames look aside, for want of a better estimate."""
    seen, settling = perception.observation, state.settling
    before = settling.settled_aside if settling.settled else 0.0
    if seen is None or not state.phase.straight or not is_in_doubt(measurement, settings):
        return before
    return before + (aside(seen.current, seen.desired) - before) / (state.settling.settled + 1)


def _follows(
    measurement: Measurement, previous: Measurement | None, settings: ServoSettings
) -> bool:
    """Return whether a measurement comes in time after the ``previous`` one: in a row with it."""
    if previous is None:
        return False
    gap = seconds_between(previous.stamp_ns, measurement.stamp_ns)
    return 0.0 < gap <= settings.stale_timeout
