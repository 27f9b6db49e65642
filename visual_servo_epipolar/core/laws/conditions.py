"""
Conditions on an estimate that phases share: where the goal lies, what can be trusted.

Also lines to the goal, where step 2 alone leads home as a memory of views has the offset, and how
far a run may lead away from the goal, and backward.
"""

import math

from visual_servo_epipolar.core.arrays import ROUNDING
from visual_servo_epipolar.core.estimate.goal_estimate import GoalEstimate
from visual_servo_epipolar.core.estimate.settings import DriveSettings
from visual_servo_epipolar.core.geometry.epipolar import Bearings
from visual_servo_epipolar.core.laws import equations
from visual_servo_epipolar.core.laws.arrival import engage_bound
from visual_servo_epipolar.core.laws.memory import Memory
from visual_servo_epipolar.core.laws.phase import Event
from visual_servo_epipolar.core.odometry.legs import (
    LEAST_LOOK_AHEAD,
    LEAST_REMEMBERED,
    Leg,
    look_ahead,
    LOOK_AHEADS,
    UNKNOWN_RANGE,
)
from visual_servo_epipolar.core.reasons import Reason

ROOM = 0.18  # behind a goal whose place is known, to begin step 1 [m]
KNOWN = 0.009  # deviation of its bearing from there [rad]
RESIDUAL_OFFSET = 5e-4  # that line following may leave [m]
LAST_LOOK_AHEAD = 0.03  # near the goal [m]
LAST_TURN = 0.05  # that it may take [rad]
MOST_TURNED = 0.35  # heading error to begin with [rad]
# Of ways, over the bound of the distance; of laws without retreat, over what others drive back.
MARGIN = 1.5
CORRECTION = 0.1  # backward, of a robot that never backs off [m]
LEAST_FIRST = 0.5  # distance that a ratio of distances refers to at least [m]


def is_sideways(goal: GoalEstimate, settings: DriveSettings, *, factor: float = 0.0) -> bool:
    """
    Return whether a law with retreat backs off before step 1.

    From beside or past the goal, and where the field of view leaves no room for a displacement
    that would bring the robot onto the axis before it is at the goal. Once begun, step 1 is given
    up for it with a ``factor`` of hysteresis.
    """
    bearings, law = goal.bearings, settings.options
    if not law.retreat or bearings is None:
        return False
    if not is_behind(bearings) or abs(bearings.chi) > settings.sideways_bearing:
        return True
    if not law.discordant_turn:
        return False
    least_ratio = settings.least_spiral_ratio ** (1.0 + factor)
    return displacement(goal, settings, least_ratio=least_ratio) is None


def is_far_enough(goal: GoalEstimate, settings: DriveSettings) -> bool:
    """Return whether there is room for step 1; with a memory of the goal less is needed."""
    known = goal.deviation <= KNOWN
    if goal.offset is not None and goal.offset[1] <= -ROOM and known:
        return True
    return goal.difference <= -settings.retreat_difference


def is_behind(bearings: Bearings) -> bool:
    """Return whether the robot is behind the goal and faces it."""
    return bearings.sigma < 0.0 and math.sin(bearings.psi) < 0.0


def displacement(
    goal: GoalEstimate, settings: DriveSettings, *, least_ratio: float | None = None
) -> float | None:
    """
    Return the bearing of e_au [rad] to hold in step 1, as far as the field of view allows.

    None where the spiral would end below ``least_ratio`` of its first distance, by default that of
    the settings: see ``equations.displaced_epipole``.
    """
    bearings = goal.bearings
    if bearings is None:
        return None
    alpha, chi = bearings.alpha, bearings.chi
    epipole = equations.displaced_epipole(
        bearings.epipole_desired,
        ratio=settings.spiral_ratio,
        low=settings.min_displacement,
        high=settings.max_displacement,
    )
    left, right = goal.view_margins
    target = math.atan(epipole)
    visible = min(max(target, alpha - right), alpha + left)
    if abs(chi) <= engage_bound(goal, settings) or visible == target:
        return visible
    least_tangent = abs(chi) / math.log(1.0 / (least_ratio or settings.least_spiral_ratio))
    ends_in_time = visible * target > 0.0 and math.tan(abs(visible)) >= least_tangent
    return visible if ends_in_time else None


def discordant_bearing(goal: GoalEstimate, settings: DriveSettings) -> float:
    """
    Return the bearing of e_au [rad] for DISPLACING, 0 where there is none.

    A law without retreat takes what the field of view allows, however near the goal the spiral
    ends: it has no other way to begin.
    """
    least_ratio = None if settings.options.retreat else ROUNDING
    return displacement(goal, settings, least_ratio=least_ratio) or 0.0


def sees_too_little(goal: GoalEstimate, settings: DriveSettings) -> bool:
    """Return whether too few features are in view, and no memory of views carries on."""
    return goal.features < settings.min_features and not goal.carried


def turned_by_far(heading: float, trusted: float) -> bool:
    """
    Return whether a ``heading`` is not the last ``trusted`` one, by far [rad].

    No robot turns by a radian between two images, or while it stands.
    """
    return abs(math.remainder(heading - trusted, 2.0 * math.pi)) > 1.0


def begun_step_1(goal: GoalEstimate, settings: DriveSettings, event: Event) -> Event:
    """Return the ``event`` that begins step 1; where there is no room the robot backs off."""
    room = is_far_enough(goal, settings) and not is_sideways(goal, settings)
    return event if room or not settings.options.retreat else Event.SIDEWAYS


def with_new_leg(goal: GoalEstimate, memory: Memory) -> Memory:
    """Return ``memory`` where step 1 begins: the side of e_du, not at zero yet, and a new leg."""
    if goal.bearings is None:
        return memory
    side = math.copysign(1.0, goal.bearings.chi)
    return memory.changed(side=side, latched=False, leg=Leg())


def line_look_ahead(goal: GoalEstimate, settings: DriveSettings) -> float:
    """
    Return the look-ahead of line following [m]: shorter where the offset is known.

    What only the last decimetres show of that is undone there, within half of the way that is
    left; the turn that it takes is small, and undone at the goal.
    """
    if goal.offset is None:
        return look_ahead(goal.distance(), settings.look_ahead)
    x, y = goal.offset
    gentle = max(abs(x), goal.offset_deviation) / LAST_TURN
    least = min(max(-0.5 * y, LAST_LOOK_AHEAD, gentle), LEAST_REMEMBERED)
    return _remembered_look_ahead(y, settings, least)


def _remembered_look_ahead(
    y: float, settings: DriveSettings, least: float = LEAST_REMEMBERED
) -> float:
    """Return the look-ahead [m] where a memory of views has the robot ``y`` ahead of the goal."""
    return look_ahead(max(-y, LEAST_REMEMBERED), settings.look_ahead, least=least)


def offset_ratio(distance: float, goal: GoalEstimate, settings: DriveSettings) -> float:
    """
    Return the part of an offset that line following leaves over a ``distance`` to the goal [m].

    It falls by exp(-0.9 ds / L) over ds, and the look-ahead L shrinks with the way that is left: a
    quarter of that, between its bounds.
    """
    least = LEAST_LOOK_AHEAD if goal.offset is None else LEAST_REMEMBERED
    least = min(least, settings.look_ahead)
    near, far = LOOK_AHEADS * least, LOOK_AHEADS * settings.look_ahead
    lengths = min(distance, near) / least + max(distance - far, 0.0) / settings.look_ahead
    lengths += LOOK_AHEADS * math.log(max(min(distance, far), near) / near)
    return math.exp(-equations.LINE_DAMPING * lengths)


def leads_home(goal: GoalEstimate, settings: DriveSettings) -> bool:
    """Return whether line following from here ends on the goal, as far as the offset is known."""
    if goal.offset is None or not settings.options.line_following:
        return False
    x, y = goal.offset
    length, turned = _remembered_look_ahead(y, settings), goal.heading_error
    # From more than half a look-ahead aside features would be turned out of view.
    if y > -length or abs(turned) > MOST_TURNED or abs(x) > 0.5 * length:
        return False
    aside = abs(x) + length * math.tan(abs(turned))
    return aside * math.exp(equations.LINE_DAMPING * y / length) <= RESIDUAL_OFFSET


def lateral_offset(goal: GoalEstimate) -> float:
    """Return the lateral offset x = d cos(psi) [m], right positive; 0 without bearings."""
    if goal.offset is not None:
        return goal.offset[0]
    if goal.bearings is None:
        return 0.0
    return goal.distance(UNKNOWN_RANGE) * math.cos(goal.bearings.psi)


def excursion_limit(goal: GoalEstimate, memory: Memory, settings: DriveSettings) -> str:
    """
    Return in words that the robot is farther from the goal than its run may lead it.

    What is driven backward has a bound of its own, over all phases and attempts; a robot without
    room corrects by decimetres near the goal alone. Laws without
    retreat, whose first step may lead away by itself, have a wider one. In steps 1 and 2 of a law
    that spirals inwards the distance hardly grows, and no way is longer than its upper bound
    allows; of twice as long a one while less is left, by the memory of views, than half of it.
    """
    name, law = memory.phase.value, settings.options
    backward, wider = goal.motion.reversed, 1.0 if law.retreat else MARGIN
    if settings.max_retreat == 0.0 and memory.phase.backs_off:
        return Reason.NO_RETREAT.of()
    if backward > wider * max(settings.max_retreat, CORRECTION):
        return Reason.BACKWARD.of(backward, name)
    spirals = law.discordant_turn and law.retreat  # laws without lead away first
    if not spirals or not memory.phase.closes_in:
        return ''
    offset, travel = goal.offset, abs(memory.run.travel)
    nears = offset is not None and math.hypot(*offset) < 0.5 * travel
    bounds = 2.0 * MARGIN if nears else MARGIN
    longest = bounds * settings.initial_distance + backward
    if travel > longest:
        return Reason.LONG_WAY.of(longest, name)
    ratio = _excursion(goal, memory)
    if settings.max_excursion == 0.0 or ratio <= settings.max_excursion:
        return ''
    return Reason.EXCURSION.of(name, ratio)


def _excursion(goal: GoalEstimate, memory: Memory) -> float:
    """
    Return the distance over that at which the leg began; 1 where it is not known.

    What the leg has led backward is left out, up to a metre: near the goal step 1 may need it.
    """
    leg, bearings, distance = memory.law.leg, goal.bearings, goal.range
    if leg is None or bearings is None or math.isnan(distance):
        return 1.0
    x = distance * math.cos(bearings.psi) - leg.x
    y = distance * math.sin(bearings.psi) - leg.y
    backward = min(max(-leg.travel, 0.0), 1.0)
    return (distance - backward) / max(math.hypot(x, y), LEAST_FIRST)
