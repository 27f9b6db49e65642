"""
Arrival: whether the robot is at the goal, by two views or by a memory of views.

The tolerances of the owner are held against what is measured and what that may be wrong by. A
memory of views gives the offset in metres; two views give D alone, which the slope that it has
shown while driving turns into metres along the axis: an offset aside shows only as parallax.
"""

import math

from visual_servo_epipolar.core.estimate.settings import DriveSettings
from visual_servo_epipolar.core.laws.phases.bounds import (
    FACING,
    facing_bound,
    is_matched,
    NOISE_DEVIATIONS,
    trial_of,
)
from visual_servo_epipolar.core.laws.state import DriveState
from visual_servo_epipolar.core.perception.measurement import Measurement

STANDSTILL_PARALLAX = 1.25  # without a baseline, in deviations of the noise: see ``fit_rotation``
ARRIVAL_OFFSET = 2e-3  # of a robot that has arrived, by its memory of views [m]
STILL_THERE = 1.0  # deviations: a robot that has arrived is not sent away by noise
ASIDE = 2.0  # deviations of a mean over looks, all of which share the photograph's noise
CLEARLY_ASIDE = 4.0  # of a mean over a few
CONTRADICTED = 4.0  # bounds of a parallax, beyond which no memory says that it is the goal


def has_parallax(state: DriveState, measurement: Measurement, settings: DriveSettings) -> bool:
    """
    Return whether the parallax exceeds what noise explains: the robot is not at the goal.

    A memory of views gives it far better, but through a wrongly configured lens its geometry may
    be one that is not there: it never overrules an image that looks another.
    """
    if _looks_elsewhere(state, measurement, settings):
        return True
    if measurement.offset is None:
        return False
    x, y = measurement.offset
    if is_matched(measurement, settings, trial_of(state, spent=True)):
        y = 0.0  # no attempt comes nearer along the axis
    return not math.hypot(x, y) <= _offset_bound(state, measurement, settings)


def _looks_elsewhere(state: DriveState, measurement: Measurement, settings: DriveSettings) -> bool:
    """Return whether the image shows more parallax than noise and the way that is left explain."""
    parallax = (
        measurement.parallax if state.settling.settled < 2 else state.settling.settled_parallax
    )
    # The root of a mean square over N features varies by 0.5 / sqrt(N) and more.
    variation = 1.0 + 1.5 / math.sqrt(max(measurement.features, 1))
    if is_in_doubt(measurement, settings) and state.run.attempts == 1:
        variation = 1.0  # it has looked for long, and a small way back and forth will tell
        if abs(state.settling.settled_aside) > ASIDE:
            return True
    noise = STANDSTILL_PARALLAX * measurement.noise * variation
    usual = math.hypot(settings.arrival_parallax, noise)
    if settings.arrival_position > 0.0:
        usual = math.hypot(usual, _of_the_rest(measurement))
    return not parallax <= (usual if measurement.offset is None else CONTRADICTED * usual)


def _of_the_rest(measurement: Measurement) -> float:
    """Return the parallax that the way left to the goal makes, or somewhat more [rad]."""
    if measurement.offset is None:
        return abs(measurement.difference)
    return measurement.difference_slope * math.hypot(*measurement.offset)


def _offset_bound(state: DriveState, measurement: Measurement, settings: DriveSettings) -> float:
    """Return the largest offset of a robot that has arrived, as its memory measures it [m]."""
    noise = NOISE_DEVIATIONS * measurement.offset_deviation
    tolerance = settings.arrival_position
    if tolerance > 0.0:  # a promise: no attempt makes it larger, and no noise
        return max(tolerance - noise, min(noise, tolerance))
    # A worn base may never come as near as the memory can tell: each attempt asks for less.
    if state.run.attempts == 1:
        noise = measurement.offset_deviation
    return max(ARRIVAL_OFFSET * state.run.attempts, noise)


def is_near_enough(
    state: DriveState,
    measurement: Measurement,
    settings: DriveSettings,
    *,
    deviations: float = NOISE_DEVIATIONS,
) -> bool:
    """
    Return whether the place is within the owner's tolerance, also once the robot has stopped.

    So are ``deviations`` of what is measured. Without a final turn the heading counts as well.
    """
    if settings.arrival_position == 0.0 or _looks_elsewhere(state, measurement, settings):
        return False
    if not (settings.options.final_turn or faces_goal(state, measurement, settings)):
        return False
    ahead = stopping(state.twist.linear, settings.max_acceleration, settings)
    if measurement.offset is not None:
        x, y = measurement.offset
        reach = settings.arrival_position - deviations * measurement.offset_deviation
        return max(math.hypot(x, y), math.hypot(x, y + ahead)) <= reach
    difference, noise = measurement.difference, measurement.difference_deviation
    slope = state.motion.slope.least(noise)
    reach = slope * settings.arrival_position - deviations * noise
    return max(abs(difference), abs(difference + slope * ahead)) <= reach


def faces_goal(state: DriveState, measurement: Measurement, settings: DriveSettings) -> bool:
    """Return whether the heading is the goal's, where asked also once the robot has stopped."""
    bound = facing_bound(measurement, settings, trial_of(state))
    heading, turn = measurement.heading_error, 0.0
    if settings.arrival_heading > FACING:
        turn = stopping(state.twist.angular, settings.max_angular_acceleration, settings)
    return max(abs(heading), abs(heading + turn)) <= bound


def stopping(speed: float, deceleration: float, settings: DriveSettings) -> float:
    """Return what a robot of this speed moves on by until it stands [m] or [rad]."""
    return speed * (settings.latency + 0.5 * abs(speed) / deceleration)


def is_in_doubt(measurement: Measurement, settings: DriveSettings) -> bool:
    """Return whether a memory of views would know whether this is the goal, but there is none."""
    return settings.remembers and measurement.offset is None


def stands_aside(state: DriveState, measurement: Measurement, settings: DriveSettings) -> bool:
    """Return whether a few looks suffice in doubt: the robot stands clearly aside."""
    first = is_in_doubt(measurement, settings) and state.run.attempts == 1
    return first and abs(state.settling.settled_aside) > CLEARLY_ASIDE


def is_at_goal(state: DriveState, measurement: Measurement, settings: DriveSettings) -> bool:
    """
    Return whether heading, parallax and D are those of the photograph, within their noise.

    In doubt the robot looks for longer, in step 2.
    """
    if is_in_doubt(measurement, settings):
        return False
    if not faces_goal(state, measurement, settings):
        return False
    if is_matched(measurement, settings, trial_of(state, spent=True)):
        return not has_parallax(state, measurement, settings)
    return is_near_enough(state, measurement, settings, deviations=STILL_THERE)
