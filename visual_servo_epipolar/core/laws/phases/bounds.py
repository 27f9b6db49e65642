"""
Bounds below which a measurement counts as zero: no finer than its noise, nor than the base moves.

With the offset of a memory of views they are finer than with two views. A base may be
unable to come as near, and its dead band need not be configured: after 0.8 s within the usual
tolerance that is enough. The tolerances of the owner make them coarser, less what the measurement
may be wrong by.
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
    """Return whether turns end in place, by pulses: see ``servo.pulsed_move``."""
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
