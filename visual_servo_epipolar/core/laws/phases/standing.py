"""Phases in which the robot stands: before a run, after it, and while it cannot go on."""

import math

from visual_servo_epipolar.core.estimate.settings import DriveSettings
from visual_servo_epipolar.core.laws.machine import PhaseRow
from visual_servo_epipolar.core.laws.phase import Event, Phase
from visual_servo_epipolar.core.laws.phases.arrival import is_at_goal
from visual_servo_epipolar.core.laws.phases.bounds import align_bound, engage_bound
from visual_servo_epipolar.core.laws.phases.conditions import has_turned, is_sideways, is_untrusted
from visual_servo_epipolar.core.laws.phases.probing import begun_probe
from visual_servo_epipolar.core.laws.state import ServoState
from visual_servo_epipolar.core.perception.measurement import Measurement

# In a row that must be trusted before the robot moves again; where it is said to have turned
# meanwhile, somebody must have turned it.
RESUMING_FRAMES, TURNED_FRAMES = 3, 15


def survey(state: ServoState, measurement: Measurement, settings: DriveSettings) -> Event:
    """Return the event that begins a run, or resumes it after the tracks came back."""
    if measurement.bearings is None and not math.isfinite(measurement.difference):
        return Event.LOST
    if is_at_goal(state, measurement, settings):
        return Event.MATCHED
    if measurement.bearings is None:
        if measurement.parallax <= settings.near_parallax:
            return Event.NO_BASELINE
        return begun_probe(state, measurement, settings) if measurement.rivals else Event.LOST
    if is_sideways(measurement, settings):
        return Event.SIDEWAYS
    aligned = abs(measurement.bearings.chi) <= engage_bound(measurement, settings)
    if aligned and abs(measurement.bearings.alpha) <= align_bound(measurement, settings):
        return Event.ALIGNED
    return Event.APART


def _resume(state: ServoState, measurement: Measurement, settings: DriveSettings) -> Event:
    """Return the event of a survey, after enough images in a row that can be trusted."""
    # Where images are false, a single one may look right.
    if state.settling.settled < (
        TURNED_FRAMES if has_turned(state, measurement) else RESUMING_FRAMES
    ):
        return Event.NOTHING
    return survey(state, measurement, settings)


WAITING = PhaseRow(phase=Phase.WAITING, words='stands', colour='#B0B0B0', classify=survey)
HOLDING = PhaseRow(
    phase=Phase.HOLDING,
    words='stands until its tracks are back and trusted',
    colour='#F0E442',  # faint on white: the robot stands
    classify=_resume,
    is_settled=lambda _, measurement, settings: (
        bool(measurement.rivals) or not is_untrusted(measurement, settings)
    ),
)
ARRIVED = PhaseRow(phase=Phase.ARRIVED, words='stands at the goal', colour='#44337A')
FAILED = PhaseRow(phase=Phase.FAILED, words='stands, the run is over', colour='#D55E00')
STANDING = (WAITING, HOLDING, ARRIVED, FAILED)
