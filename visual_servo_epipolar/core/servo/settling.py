"""Settling: frames in a row that fulfil the aim of a phase, and what they show on average."""

from dataclasses import replace
import math
from typing import Any

from visual_servo_epipolar.core.geometry.wall import aside
from visual_servo_epipolar.core.laws.machine import PhaseRow
from visual_servo_epipolar.core.laws.phase import Phase
from visual_servo_epipolar.core.laws.phases.arrival import is_in_doubt
from visual_servo_epipolar.core.laws.phases.conditions import sees_too_little
from visual_servo_epipolar.core.laws.timing import predicted
from visual_servo_epipolar.core.perception.measurement import Measurement
from visual_servo_epipolar.core.perception.perceive import Perception
from visual_servo_epipolar.core.servo.settings import ServoSettings
from visual_servo_epipolar.core.servo.state import ServoState
from visual_servo_epipolar.core.stamps import seconds_between

SEEN_S = 0.4  # after which a motion has acted and was seen, of a base that obeys in time


def row_of(state: ServoState, settings: ServoSettings) -> PhaseRow:
    """Return the row of the present phase, of the law that drives."""
    return settings.machine.row(state.phase)


def at_rest(state: ServoState) -> ServoState:
    """Return ``state`` with the mean of its measurements since it stands, if it does."""
    mean = state.settling.rest
    return state if mean is None else state.changed(measurement=mean)


def is_settled(state: ServoState, settings: ServoSettings) -> bool:
    """Return whether this frame fulfils the aim of the phase."""
    if state.settling.rest is not None:
        return _is_settled(at_rest(state), settings)
    if not _is_settled(state, settings):
        return False
    # Commands that have not acted yet must not lead away again.
    ahead = predicted(state, settings)
    return ahead is state or _is_settled(ahead, settings)


def _is_settled(state: ServoState, settings: ServoSettings) -> bool:
    """Return whether the measurement of ``state`` fulfils the aim of the phase."""
    measurement = state.measurement
    if measurement is None or sees_too_little(measurement, settings):
        return False
    return row_of(state, settings).is_settled(state, measurement, settings)


def is_close(state: ServoState, settings: ServoSettings) -> bool:
    """Return whether this frame is within the usual bounds, where a memory asks for finer ones."""
    state = at_rest(state)
    measurement = state.measurement
    if measurement is None:
        return False
    return row_of(state, settings).is_close(state, measurement, settings)


def settle(
    state: ServoState,
    perception: Perception,
    previous: Measurement | None,
    dt: float,
    settings: ServoSettings,
) -> ServoState:
    """Return the state with its count of settled frames, ``dt`` [s] after the ``previous``."""
    state = state.changed(**_rest(state, settings))
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


def _rest(state: ServoState, settings: ServoSettings) -> dict[str, Any]:
    """Return the mean of what is measured since the robot stands, in the fields of the state."""
    now, before, rested = state.measurement, state.settling.rest, state.settling.rested + 1
    if (
        now is None
        or not math.isfinite(now.difference)
        or not state.phase.drives
        or state.motion.sent.rest_s(now.stamp_ns) < seen_after(settings)
    ):
        return {'rest': None, 'rested': 0, 'rest_square': 0.0}
    if before is None or (before.offset is None) is not (now.offset is None):
        return {'rest': now, 'rested': 1, 'rest_square': 0.0}
    change = now.difference - before.difference
    turn = math.remainder(now.heading_error - before.heading_error, 2.0 * math.pi)
    mean = replace(
        now,
        difference=before.difference + change / rested,
        heading_error=before.heading_error + turn / rested,
    )
    if now.offset is not None and before.offset is not None:
        (x, y), (last_x, last_y) = now.offset, before.offset
        mean = replace(
            mean, offset=(last_x + (x - last_x) / rested, last_y + (y - last_y) / rested)
        )
    square = state.settling.rest_square + change * (now.difference - mean.difference)
    return {'rest': mean, 'rested': rested, 'rest_square': square}


def seen_after(settings: ServoSettings) -> float:
    """Return the time after which a motion that was commanded has acted and was seen [s]."""
    return max(SEEN_S, settings.latency + SEEN_S / 3.0)


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
