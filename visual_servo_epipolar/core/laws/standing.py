"""
Phases that any law has: standing, orienting, retreating; and probing before a plane.

The robot stands before, after and in a run; it turns to the photograph's heading; and it backs off
at that heading, to come in from behind. Where two geometries fit a plane, only motion tells them
apart: it drives straight on, or back near the goal, in legs between which it turns a little, as a
leg along the baseline tells nothing. Once one geometry is left it stands, and surveys the goal.
"""

import math

from visual_servo_epipolar.core.bases.base import turns_in_place
from visual_servo_epipolar.core.estimate.goal_estimate import GoalEstimate
from visual_servo_epipolar.core.estimate.settings import DriveSettings
from visual_servo_epipolar.core.geometry.motion import STANDSTILL, Twist
from visual_servo_epipolar.core.laws import arrival, conditions
from visual_servo_epipolar.core.laws.braking import settled_turn
from visual_servo_epipolar.core.laws.machine import PhaseRow
from visual_servo_epipolar.core.laws.memory import Memory
from visual_servo_epipolar.core.laws.phase import Event, Phase

RESUMING_FRAMES = 3  # in a row that must be trusted before the robot moves again
LEG, SWINGS = 0.3, (0.0, 0.3, -0.3)  # way of a leg [m], and how far aside each leads [rad]


def survey(goal: GoalEstimate, memory: Memory, settings: DriveSettings) -> Event:
    """Return the event that begins a run, or resumes it after the tracks came back."""
    if goal.bearings is None and not math.isfinite(goal.difference):
        return Event.LOST
    if arrival.is_at_goal(goal, memory, settings):
        return Event.MATCHED
    if goal.bearings is None:
        if goal.parallax <= settings.near_parallax:
            return Event.NO_BASELINE
        return begun_probe(goal, memory, settings) if goal.rivals else Event.LOST
    if conditions.is_sideways(goal, settings):
        return Event.SIDEWAYS
    aligned = abs(goal.bearings.chi) <= arrival.engage_bound(goal, settings)
    if aligned and abs(goal.bearings.alpha) <= arrival.align_bound(goal, memory, settings):
        return Event.ALIGNED
    return Event.APART


def _resume(goal: GoalEstimate, memory: Memory, settings: DriveSettings) -> Event:
    """Return the event of a survey, after enough images in a row that can be trusted."""
    # Where images are false, a single one may look right.
    turned = conditions.turned_by_far(goal.heading_error, goal.trusted_heading)
    # Of a robot that appears to have turned meanwhile, somebody must have turned it.
    times = settings.arrival_frames if turned else 1
    if memory.settling.settled < times * RESUMING_FRAMES:
        return Event.NOTHING
    return survey(goal, memory, settings)


WAITING = PhaseRow(phase=Phase.WAITING, words='stands', colour='#B0B0B0', classify=survey)
HOLDING = PhaseRow(
    phase=Phase.HOLDING,
    words='stands until its tracks are back and trusted',
    colour='#F0E442',  # faint on white: the robot stands
    classify=_resume,
    is_settled=lambda goal, _, settings: (
        bool(goal.rivals) or not goal.is_untrusted(settings.near_parallax)
    ),
)
ARRIVED = PhaseRow(phase=Phase.ARRIVED, words='stands at the goal', colour='#44337A')
FAILED = PhaseRow(phase=Phase.FAILED, words='stands, the run is over', colour='#D55E00')


def _oriented(goal: GoalEstimate, memory: Memory, settings: DriveSettings) -> Event:
    if memory.settling.settled < settings.align_frames:
        return Event.NOTHING
    if arrival.is_at_goal(goal, memory, settings):
        return Event.MATCHED
    if conditions.is_sideways(goal, settings):
        return Event.SIDEWAYS
    if goal.bearings is not None:
        return conditions.begun_step_1(goal, settings, Event.APART)
    # At the goal's heading and still no baseline: step 2 removes the residual.
    return Event.ALIGNED


ORIENTING = PhaseRow(
    phase=Phase.ORIENTING,
    words='turns in place to the heading of the photograph',
    colour='#CC79A7',
    classify=_oriented,
    command=lambda goal, _, settings: Twist(
        0.0, settled_turn(-goal.heading_error, goal, settings)
    ),
    is_settled=arrival.faces_goal,
    is_close=lambda goal, memory, settings: (
        abs(goal.heading_error) <= arrival.facing_bound(goal, memory, settings, spent=True)
    ),
)


def _retreated(goal: GoalEstimate, memory: Memory, settings: DriveSettings) -> Event:
    if goal.is_untrusted(settings.near_parallax):
        return Event.LOST
    if not has_run_up(goal, memory, settings):
        return Event.NOTHING
    if conditions.leads_home(goal, settings):
        return Event.ALIGNED
    if goal.bearings is None or not conditions.is_far_enough(goal, settings):
        return Event.NOTHING
    within = abs(goal.bearings.chi) <= settings.retreat_bearing
    return Event.APART if within and not conditions.is_sideways(goal, settings) else Event.NOTHING


def has_run_up(goal: GoalEstimate, memory: Memory, settings: DriveSettings) -> bool:
    """
    Return whether a retreat after a miss has led as far as that asks for.

    After two misses the goal is less certain than its deviation says: before a wall, straight
    back, a short way tells hardly what is aside.
    """
    misses = memory.run.attempts - 1
    return misses < 2 or goal.difference <= -misses * settings.retreat_difference


def _retreat(goal: GoalEstimate, memory: Memory, settings: DriveSettings) -> Twist:
    """Return the turn to the goal's heading as far as the view allows, then with backing off."""
    if settings.max_retreat == 0.0:
        return STANDSTILL
    left, right = goal.view_margins
    angle = min(max(-goal.heading_error, -right), left)
    turning = abs(angle) > settings.retreat_heading
    return Twist(0.0 if turning else -settings.retreat_speed, settled_turn(angle, goal, settings))


RETREATING = PhaseRow(
    phase=Phase.RETREATING,
    words='backs off, to come in from behind',
    colour='#E69F00',
    classify=_retreated,
    command=_retreat,
    begin=lambda _, memory, __: memory.changed(leg=None),  # an excursion of step 1 begins after it
)


def begun_probe(goal: GoalEstimate, memory: Memory, settings: DriveSettings) -> Event:
    """Return the event that begins a probe where ``goal`` has rivals: LOST if none may."""
    if not settings.remembers or memory.run.restarts >= len(SWINGS):
        return Event.LOST
    if _leads_ahead(goal, settings):
        return Event.AMBIGUOUS
    return Event.AMBIGUOUS_NEAR if settings.max_retreat > 0.0 else Event.LOST


def is_probing(memory: Memory) -> bool:
    """Return whether the phase is a probe."""
    return memory.phase.drives and memory.run.event in (Event.AMBIGUOUS, Event.AMBIGUOUS_NEAR)


def classify_probe(goal: GoalEstimate, memory: Memory, settings: DriveSettings) -> Event:
    """Return the event of a probe: whether one geometry is left, or it ends without."""
    if goal.bearings is not None or not goal.rivals:
        return Event.LOST if goal.bearings is None else Event.RESOLVED
    way, most = 0.0 if goal.followed is None else goal.followed.way, len(SWINGS) * LEG
    if memory.phase.backs_off:
        spent = way > min(most, 0.9 * settings.max_retreat)
    else:
        spent = way > most or not _leads_ahead(goal, settings)
    return Event.LOST if spent else Event.NOTHING


def probe(goal: GoalEstimate, memory: Memory, settings: DriveSettings) -> Twist:
    """Return the velocity of a probe: straight on, or the turn to the next leg."""
    angle = _turn_left(goal)
    if turns_in_place(settings.drive) and abs(angle) > settings.displacement_tolerance:
        return Twist(0.0, settled_turn(angle, goal, settings))
    return Twist(
        -settings.retreat_speed if memory.phase.backs_off else settings.retreat_speed, 0.0
    )


def _turn_left(goal: GoalEstimate) -> float:
    """Return the turn to the heading of the leg, as far as the view allows [rad]."""
    rivals = goal.followed
    if rivals is None:
        return 0.0
    swing = SWINGS[min(int(rivals.way / LEG), len(SWINGS) - 1)]
    turned = math.remainder(goal.rotation_heading - rivals.turn, 2.0 * math.pi)
    left, right = goal.view_margins
    return min(max(swing - turned, -right), left)


def _leads_ahead(goal: GoalEstimate, settings: DriveSettings) -> bool:
    """Return whether the goal is ahead by both geometries, and not near."""
    ahead = max(abs(each.alpha) for each in goal.rivals) <= settings.sideways_bearing
    return ahead and conditions.is_far_enough(goal, settings)
