"""
Arrival: whether this is the goal, as far as two views or a memory of views can tell.

Bounds below which a measurement counts as zero are no finer than its noise, nor than the base
moves; where a memory of views knows the offset they are finer than two views could tell. A base
may be unable to come as near, and its dead band need not be configured: after a while within the
usual tolerance that is enough.

The tolerances of the owner are held against what is measured and what that may be wrong by. A
memory of views knows the offset in metres; two views know D alone, which the slope that it has
shown while driving turns into metres along the axis: what is aside only parallax tells.
"""

import math
from typing import NamedTuple

from visual_servo_epipolar.core.estimate.settings import DriveSettings
from visual_servo_epipolar.core.laws.state import DriveState
from visual_servo_epipolar.core.laws.timing import usual_step, USUAL_STEP_S
from visual_servo_epipolar.core.perception.measurement import Measurement

ENGAGE_DEVIATIONS, RELEASE_DEVIATIONS, NOISE_DEVIATIONS = 1.0, 4.0, 2.0
LEAST_OFFSET, LEAST_HEADING = 4e-5, 2e-5  # that a memory of views bothers about [m], [rad]
NEGLIGIBLE = 0.3  # deviations of what a memory says: more would be a bias of arrivals from behind
PULSE_MISS = 0.15  # of a hop, by which stretched pulses miss: a base slips
FACING = 6e-4  # heading error that two views leave; what a tolerance is less by, too [rad]
MOST_HYSTERESIS = 4.0
PATIENCE_S = 0.8  # within the usual bounds, after which they are enough
STANDSTILL_PARALLAX = 1.25  # without a baseline, in deviations of the noise: see ``fit_rotation``
ARRIVAL_OFFSET = 2e-3  # of a robot that has arrived, by its memory of views [m]
STILL_THERE = 1.0  # deviations: a robot that has arrived is not sent away by noise
ASIDE = 2.0  # deviations of a mean over looks, all of which share the photograph's noise
CLEARLY_ASIDE = 4.0  # of a mean over a few
CONTRADICTED = 4.0  # bounds of a parallax, beyond which no memory says that it is the goal


class Trial(NamedTuple):
    """Time within the usual bounds by now, that from one command to the next, its jitter [s]."""

    time_in_tolerance: float = 0.0
    frame_s: float = USUAL_STEP_S
    jitter_s: float = 0.0


FIRST = Trial()


def trial_of(state: DriveState, *, spent: bool = False) -> Trial:
    """Return how long the robot has tried by now; for ever if its patience is ``spent``."""
    tried = math.inf if spent else state.settling.time_in_tolerance
    return Trial(tried, usual_step(state), jitter_s=state.view.jitter)


def engage_bound(measurement: Measurement, settings: DriveSettings) -> float:
    """Return the largest bearing of e_du [rad] that counts as zero, its noise at least."""
    return max(settings.latch_engage, ENGAGE_DEVIATIONS * _deviation(measurement))


def release_bound(measurement: Measurement, settings: DriveSettings) -> float:
    """Return the bearing of e_du [rad] beyond which it has left zero, and not by noise alone."""
    return max(settings.latch_release, RELEASE_DEVIATIONS * _deviation(measurement))


def hysteresis(state: DriveState, settings: DriveSettings) -> float:
    """
    Return the factor by which step 1 is held on to: one for both steps.

    It doubles each time step 1 was given up in this attempt, for a retreat or a new beginning:
    what spoke against it may be noise, or a wrongly configured geometry.
    """
    if not settings.options.retreat:
        return 1.0
    return min(2.0**state.run.restarts, MOST_HYSTERESIS)


def align_bound(measurement: Measurement, settings: DriveSettings) -> float:
    """Return the largest bearing of e_au [rad] that counts as zero, its noise at least."""
    return max(settings.align_tolerance, ENGAGE_DEVIATIONS * _deviation(measurement))


def facing_bound(measurement: Measurement, settings: DriveSettings, trial: Trial = FIRST) -> float:
    """Return the largest heading error [rad] that counts as zero, half of the least turn."""
    tolerance, deviation = settings.arrival_heading, 0.0
    fine = min(tolerance, FACING)
    if measurement.offset is not None:
        deviation = measurement.heading_deviation
        if _is_patient(trial):
            fine = min(max(NEGLIGIBLE * deviation, LEAST_HEADING), fine)
    bound = max(fine, tolerance - FACING - NOISE_DEVIATIONS * deviation)
    least = _hop(settings.dead_band_angular, settings, trial)
    if ends_by_pulses(measurement, settings) and _is_patient(trial):
        # Of two pulses, one away and one back, neither lasts for exactly a frame.
        miss = max(PULSE_MISS * trial.frame_s, 2.0 * trial.jitter_s)
        least = min(least, miss * settings.dead_band_angular)
    return max(bound, least)


def ends_by_pulses(measurement: Measurement, settings: DriveSettings) -> bool:
    """Return whether turns end in place, by pulses: see ``servo.settling``."""
    known, pulses = measurement.offset is not None, settings.dead_band_mode == 'pulse'
    return known and pulses and max(settings.dead_band_linear, settings.dead_band_angular) > 0.0


def matched_bound(
    measurement: Measurement, settings: DriveSettings, trial: Trial = FIRST
) -> float:
    """Return the largest |D|, at unit focal length, that counts as zero, its noise at least."""
    least, deviation = settings.arrival_difference, measurement.difference_deviation
    usual = max(least, NOISE_DEVIATIONS * deviation)
    if measurement.offset is None:
        return usual
    slope = measurement.difference_slope
    hop = _hop(settings.dead_band_linear, settings, trial) * slope
    fine = max(min(least, LEAST_OFFSET * slope), (1.0 if hop else NEGLIGIBLE) * deviation)
    return max(fine if _is_patient(trial) else usual, hop)


def is_matched(measurement: Measurement, settings: DriveSettings, trial: Trial = FIRST) -> bool:
    """Return whether D counts as zero."""
    return abs(measurement.difference) <= matched_bound(measurement, settings, trial)


def _is_patient(trial: Trial) -> bool:
    """Return whether the robot still tries for what is finer than usual."""
    return trial.time_in_tolerance <= PATIENCE_S


def _hop(threshold: float, settings: DriveSettings, trial: Trial) -> float:
    """Return half of the least motion of a base with this dead band, all of it if raised to it."""
    frames = 2.0 if settings.dead_band_mode == 'raise' else 0.5
    return frames * trial.frame_s * threshold


def _deviation(measurement: Measurement) -> float:
    return 0.0 if math.isnan(measurement.deviation) else measurement.deviation


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
    matched = is_matched(measurement, settings, trial_of(state, spent=True))
    if matched and settings.arrival_position == 0.0:  # a tolerance of the owner's is a promise
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
