"""
Phases that any law has: standing, orienting, retreating; and probing before a plane.

The robot stands before, after and in a run; it turns to the photograph's heading; and it backs off
at that heading, to come in from behind. Where two geometries fit a plane, only motion tells them
apart: it drives straight on, or back near the goal, in legs between which it turns a little, as a
leg along the baseline tells nothing. Once one geometry is left it stands, and surveys the goal.
"""

import math

from visual_servo_epipolar.core.bases.base import turns_in_place
from visual_servo_epipolar.core.estimate.settings import DriveSettings
from visual_servo_epipolar.core.geometry.motion import STANDSTILL, Twist
from visual_servo_epipolar.core.laws.arrival import (
    align_bound,
    engage_bound,
    faces_goal,
    facing_bound,
    is_at_goal,
    trial_of,
)
from visual_servo_epipolar.core.laws.braking import settled_turn
from visual_servo_epipolar.core.laws.conditions import (
    begun_step_1,
    has_turned,
    is_far_enough,
    is_sideways,
    is_untrusted,
    leads_home,
)
from visual_servo_epipolar.core.laws.machine import PhaseRow
from visual_servo_epipolar.core.laws.phase import Event, Phase
from visual_servo_epipolar.core.laws.state import DriveState
from visual_servo_epipolar.core.perception.measurement import Measurement
from visual_servo_epipolar.core.perception.rivals import Rivals

# In a row that must be trusted before the robot moves again; where it appears to have turned
# meanwhile, somebody must have turned it.
RESUMING_FRAMES, TURNED_FRAMES = 3, 15
LEG, LEGS = 0.3, 3  # way [m]
SWING, SWUNG = 0.3, 0.03  # of the second leg to one side, the third to the other [rad]
MOST_PROBES = 3  # in an attempt


def survey(state: DriveState, measurement: Measurement, settings: DriveSettings) -> Event:
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


def _resume(state: DriveState, measurement: Measurement, settings: DriveSettings) -> Event:
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


def _oriented(state: DriveState, measurement: Measurement, settings: DriveSettings) -> Event:
    if state.settling.settled < settings.align_frames:
        return Event.NOTHING
    if is_at_goal(state, measurement, settings):
        return Event.MATCHED
    if is_sideways(measurement, settings):
        return Event.SIDEWAYS
    if measurement.bearings is not None:
        return begun_step_1(measurement, settings, Event.APART)
    # At the goal's heading and still no baseline: step 2 removes the residual.
    return Event.ALIGNED


def _orient(state: DriveState, measurement: Measurement, settings: DriveSettings) -> Twist:
    """Return the turn in place to the goal's heading."""
    return Twist(0.0, settled_turn(-measurement.heading_error, state, settings))


def _nearly_oriented(state: DriveState, measurement: Measurement, settings: DriveSettings) -> bool:
    bound = facing_bound(measurement, settings, trial_of(state, spent=True))
    return abs(measurement.heading_error) <= bound


ORIENTING = PhaseRow(
    phase=Phase.ORIENTING,
    words='turns in place to the heading of the photograph',
    colour='#CC79A7',
    classify=_oriented,
    command=_orient,
    is_settled=faces_goal,
    is_close=_nearly_oriented,
)


def _retreated(state: DriveState, measurement: Measurement, settings: DriveSettings) -> Event:
    if is_untrusted(measurement, settings):
        return Event.LOST
    if not has_run_up(state, measurement, settings):
        return Event.NOTHING
    if leads_home(measurement, settings):
        return Event.ALIGNED
    if measurement.bearings is None or not is_far_enough(measurement, settings):
        return Event.NOTHING
    within = abs(measurement.bearings.chi) <= settings.retreat_bearing
    return Event.APART if within and not is_sideways(measurement, settings) else Event.NOTHING


def has_run_up(state: DriveState, measurement: Measurement, settings: DriveSettings) -> bool:
    """
    Return whether a retreat after a miss has led as far as that asks for.

    After two misses the goal is less certain than its deviation says: before a wall, straight
    back, a short way tells hardly what is aside.
    """
    misses = state.run.attempts - 1
    return misses < 2 or measurement.difference <= -misses * settings.retreat_difference


def _retreat(state: DriveState, measurement: Measurement, settings: DriveSettings) -> Twist:
    """Return the turn to the goal's heading as far as the view allows, then with backing off."""
    if settings.max_retreat == 0.0:
        return STANDSTILL
    left, right = measurement.view_margins
    angle = min(max(-measurement.heading_error, -right), left)
    turning = abs(angle) > settings.retreat_heading
    return Twist(0.0 if turning else -settings.retreat_speed, settled_turn(angle, state, settings))


RETREATING = PhaseRow(
    phase=Phase.RETREATING,
    words='backs off, to come in from behind',
    colour='#E69F00',
    classify=_retreated,
    command=_retreat,
    begin=lambda state, *_: state.changed(leg=None),  # which ranges the goal in step 1
)


def begun_probe(state: DriveState, measurement: Measurement, settings: DriveSettings) -> Event:
    """Return the event that begins a probe where ``measurement`` has rivals: LOST if none may."""
    if not settings.remembers or state.run.restarts >= MOST_PROBES:
        return Event.LOST
    if _leads_ahead(measurement, settings):
        return Event.AMBIGUOUS
    return Event.AMBIGUOUS_NEAR if settings.max_retreat > 0.0 else Event.LOST


def is_probing(state: DriveState) -> bool:
    """Return whether the phase is a probe."""
    return state.phase.drives and state.run.event in (Event.AMBIGUOUS, Event.AMBIGUOUS_NEAR)


def classify_probe(state: DriveState, measurement: Measurement, settings: DriveSettings) -> Event:
    """Return the event of a probe: whether one geometry is left, or it ends without."""
    if measurement.bearings is not None or not measurement.rivals:
        return Event.LOST if measurement.bearings is None else Event.RESOLVED
    if state.phase.backs_off:
        spent = _way(state) > min(LEGS * LEG, 0.9 * settings.max_retreat)
    else:
        spent = _way(state) > LEGS * LEG or not _leads_ahead(measurement, settings)
    return Event.LOST if spent else Event.NOTHING


def probe(state: DriveState, measurement: Measurement, settings: DriveSettings) -> Twist:
    """Return the velocity of a probe: straight on, or the turn to the next leg."""
    angle = _turn_left(state, measurement)
    if turns_in_place(settings.drive) and abs(angle) > SWUNG:
        return Twist(0.0, settled_turn(angle, state, settings))
    return Twist(-settings.retreat_speed if state.phase.backs_off else settings.retreat_speed, 0.0)


def _rivals(state: DriveState) -> Rivals | None:
    return None if state.view.memory is None else state.view.memory.rivals


def _way(state: DriveState) -> float:
    rivals = _rivals(state)
    return 0.0 if rivals is None else rivals.way


def _turn_left(state: DriveState, measurement: Measurement) -> float:
    """Return the turn to the heading of the leg, as far as the view allows [rad]."""
    rivals = _rivals(state)
    if rivals is None:
        return 0.0
    swing = (0.0, SWING, -SWING)[min(int(rivals.way / LEG), LEGS - 1)]
    turned = math.remainder(measurement.rotation_heading - rivals.turn, 2.0 * math.pi)
    left, right = measurement.view_margins
    return min(max(swing - turned, -right), left)


def _leads_ahead(measurement: Measurement, settings: DriveSettings) -> bool:
    """Return whether the goal is ahead by both geometries, and not near."""
    ahead = max(abs(each.alpha) for each in measurement.rivals) <= settings.sideways_bearing
    return ahead and is_far_enough(measurement, settings)
