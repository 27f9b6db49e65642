"""
Conditions on a measurement that phases share: where the goal lies, what can be trusted.

Also lines to the goal, where step 2 alone leads home as a memory of views has the offset, and how
far a run may lead away from the goal, and backward.
"""

import math

from visual_servo_epipolar.core.estimate.settings import DriveSettings
from visual_servo_epipolar.core.geometry.epipolar import Bearings
from visual_servo_epipolar.core.laws import equations
from visual_servo_epipolar.core.laws.arrival import engage_bound
from visual_servo_epipolar.core.laws.phase import Event
from visual_servo_epipolar.core.laws.state import DriveState
from visual_servo_epipolar.core.odometry.ranging import (
    LEAST_LOOK_AHEAD,
    LEAST_REMEMBERED,
    Leg,
    look_ahead,
    LOOK_AHEADS,
    UNKNOWN_RANGE,
)
from visual_servo_epipolar.core.perception.measurement import Measurement
from visual_servo_epipolar.core.reasons import Reason

TURNED = 1.0  # more than a robot turns between two images, or while it stands [rad]
ROOM = 0.18  # behind a goal whose place is known, to begin step 1 [m]
KNOWN = 0.009  # deviation of its bearing from there [rad]
LEAST_RATIO = 1e-9  # part of the distance that a law without retreat keeps
RESIDUAL_OFFSET = 5e-4  # that line following may leave [m]
LAST_SHARE, LAST_LOOK_AHEAD = 0.5, 0.03  # of the way that is left, and at least [m]
LAST_TURN = 0.05  # that it may take [rad]
MOST_ASIDE = 0.5  # offset in look-aheads: more would turn features out of view
MOST_TURNED = 0.35  # heading error to begin with [rad]
LONGEST_WAY = 1.5  # in upper bounds of the distance
LONGEST_NEARING = 3.0  # the same where the memory shows that the goal is nearer
NEARER = 0.5  # of what was driven, that is left
MOST_BACKWARD = 1.0  # of a leg, that is no excursion [m]
CORRECTION = 0.1  # backward, of a robot that never backs off [m]
LEADING_AWAY = 1.5  # what a law without retreat may drive backward, in that of others
LEAST_FIRST = 0.5  # distance that a ratio of distances refers to at least [m]


def is_sideways(measurement: Measurement, settings: DriveSettings) -> bool:
    """
    Return whether a law with retreat backs off before step 1.

    From beside or past the goal, and where the field of view leaves no room for a displacement
    that would bring the robot onto the axis before it is at the goal.
    """
    return _backs_off(measurement, settings, settings.least_spiral_ratio)


def is_off_course(
    measurement: Measurement, settings: DriveSettings, *, factor: float = 1.0
) -> bool:
    """Return whether step 1, once begun, is given up for a retreat: ``factor`` of hysteresis."""
    return _backs_off(measurement, settings, settings.least_spiral_ratio ** (1.0 + factor))


def _backs_off(measurement: Measurement, settings: DriveSettings, least_ratio: float) -> bool:
    """Return whether the goal is not ahead, or the spiral ends below ``least_ratio``."""
    bearings, law = measurement.bearings, settings.options
    if not law.retreat or bearings is None:
        return False
    if not is_behind(bearings) or abs(bearings.chi) > settings.sideways_bearing:
        return True
    if not law.discordant_turn:
        return False
    return displacement(measurement, settings, least_ratio=least_ratio) is None


def is_far_enough(measurement: Measurement, settings: DriveSettings) -> bool:
    """Return whether there is room for step 1; with a memory of the goal less is needed."""
    known = measurement.deviation <= KNOWN
    if measurement.offset is not None and measurement.offset[1] <= -ROOM and known:
        return True
    return measurement.difference <= -settings.retreat_difference


def is_behind(bearings: Bearings) -> bool:
    """Return whether the robot is behind the goal and faces it."""
    return bearings.sigma < 0.0 and math.sin(bearings.psi) < 0.0


def displacement(
    measurement: Measurement, settings: DriveSettings, *, least_ratio: float | None = None
) -> float | None:
    """
    Return the bearing of e_au [rad] to hold in step 1, as far as the field of view allows.

    None where the spiral would end below ``least_ratio`` of its first distance, by default that of
    the settings: see ``equations.displaced_epipole``.
    """
    bearings = measurement.bearings
    if bearings is None:
        return None
    alpha, chi = bearings.alpha, bearings.chi
    epipole = equations.displaced_epipole(
        bearings.epipole_desired,
        ratio=settings.spiral_ratio,
        low=settings.min_displacement,
        high=settings.max_displacement,
    )
    left, right = measurement.view_margins
    target = math.atan(epipole)
    visible = min(max(target, alpha - right), alpha + left)
    if abs(chi) <= engage_bound(measurement, settings) or visible == target:
        return visible
    least_tangent = abs(chi) / math.log(1.0 / (least_ratio or settings.least_spiral_ratio))
    ends_in_time = visible * target > 0.0 and math.tan(abs(visible)) >= least_tangent
    return visible if ends_in_time else None


def discordant_bearing(measurement: Measurement, settings: DriveSettings) -> float:
    """
    Return the bearing of e_au [rad] for DISPLACING, 0 where there is none.

    A law without retreat takes what the field of view allows, however near the goal the spiral
    ends: it has no other way to begin.
    """
    least_ratio = None if settings.options.retreat else LEAST_RATIO
    return displacement(measurement, settings, least_ratio=least_ratio) or 0.0


def sees_too_little(measurement: Measurement, settings: DriveSettings) -> bool:
    """Return whether too few features are in view, and no memory of views carries on."""
    return measurement.features < settings.min_features and not measurement.carried


def is_untrusted(measurement: Measurement, settings: DriveSettings) -> bool:
    """Return whether the bearings are not trusted, and the goal is not near or D unknown."""
    if measurement.bearings is not None:  # facing far away no feature counts in D
        return False
    is_far = measurement.parallax > settings.near_parallax
    return is_far or not math.isfinite(measurement.difference)


def has_turned(state: DriveState, measurement: Measurement) -> bool:
    """Return whether the heading is not that of the last trusted image, by far."""
    turn = math.remainder(measurement.heading_error - state.view.trusted_heading, 2.0 * math.pi)
    return abs(turn) > TURNED


def begun_step_1(measurement: Measurement, settings: DriveSettings, event: Event) -> Event:
    """Return the ``event`` that begins step 1; where there is no room the robot backs off."""
    room = is_far_enough(measurement, settings) and not is_sideways(measurement, settings)
    return event if room or not settings.options.retreat else Event.SIDEWAYS


def with_new_leg(state: DriveState, measurement: Measurement) -> DriveState:
    """Return ``state`` where step 1 begins: the side of e_du, not at zero yet, and a new leg."""
    if measurement.bearings is None:
        return state
    side = math.copysign(1.0, measurement.bearings.chi)
    return state.changed(side=side, latched=False, leg=Leg(measurement.bearings.psi))


def line_look_ahead(state: DriveState, measurement: Measurement, settings: DriveSettings) -> float:
    """
    Return the look-ahead of line following [m]: shorter where the offset is known.

    What only the last decimetres show of that is undone there, within half of the way that is
    left; the turn that it takes is small, and undone at the goal.
    """
    if measurement.offset is None:
        return look_ahead(state.motion.range, settings.look_ahead)
    x, y = measurement.offset
    gentle = max(abs(x), measurement.offset_deviation) / LAST_TURN
    least = min(max(-LAST_SHARE * y, LAST_LOOK_AHEAD, gentle), LEAST_REMEMBERED)
    return _remembered_look_ahead(y, settings, least)


def _remembered_look_ahead(
    y: float, settings: DriveSettings, least: float = LEAST_REMEMBERED
) -> float:
    """Return the look-ahead [m] where a memory of views has the robot ``y`` ahead of the goal."""
    return look_ahead(max(-y, LEAST_REMEMBERED), settings.look_ahead, least=least)


def offset_ratio(distance: float, measurement: Measurement, settings: DriveSettings) -> float:
    """
    Return the part of an offset that line following leaves over a ``distance`` to the goal [m].

    It falls by exp(-0.9 ds / L) over ds, and the look-ahead L shrinks with the way that is left: a
    quarter of that, between its bounds.
    """
    least = LEAST_LOOK_AHEAD if measurement.offset is None else LEAST_REMEMBERED
    least = min(least, settings.look_ahead)
    near, far = LOOK_AHEADS * least, LOOK_AHEADS * settings.look_ahead
    lengths = min(distance, near) / least + max(distance - far, 0.0) / settings.look_ahead
    lengths += LOOK_AHEADS * math.log(max(min(distance, far), near) / near)
    return math.exp(-equations.LINE_DAMPING * lengths)


def leads_home(measurement: Measurement, settings: DriveSettings) -> bool:
    """Return whether line following from here ends on the goal, as far as the offset is known."""
    if measurement.offset is None or not settings.options.line_following:
        return False
    x, y = measurement.offset
    length, turned = _remembered_look_ahead(y, settings), measurement.heading_error
    if y > -length or abs(turned) > MOST_TURNED or abs(x) > MOST_ASIDE * length:
        return False
    aside = abs(x) + length * math.tan(abs(turned))
    return aside * math.exp(equations.LINE_DAMPING * y / length) <= RESIDUAL_OFFSET


def lateral_offset(state: DriveState, measurement: Measurement) -> float:
    """Return the lateral offset x = d cos(psi) [m], right positive; 0 without bearings."""
    if measurement.offset is not None:
        return measurement.offset[0]
    if measurement.bearings is None:
        return 0.0
    distance = (
        min(state.motion.distance, UNKNOWN_RANGE)
        if math.isnan(state.motion.range)
        else state.motion.range
    )
    return distance * math.cos(measurement.bearings.psi)


def excursion_limit(state: DriveState, measurement: Measurement, settings: DriveSettings) -> str:
    """
    Return in words that the robot is farther from the goal than its run may lead it.

    What is driven backward has a bound of its own, over all phases and attempts; a robot without
    room corrects by decimetres near the goal alone. Laws without
    retreat, whose first step may lead away by itself, have a wider one. In steps 1 and 2 of a law
    that spirals inwards the distance hardly grows, and no way is longer than its upper bound
    allows.
    """
    name, law = state.phase.value, settings.options
    backward, wider = state.motion.reversed, 1.0 if law.retreat else LEADING_AWAY
    if settings.max_retreat == 0.0 and state.phase.backs_off:
        return Reason.NO_RETREAT.of()
    if backward > wider * max(settings.max_retreat, CORRECTION):
        return Reason.BACKWARD.of(backward, name)
    spirals = law.discordant_turn and law.retreat  # laws without lead away first
    if not spirals or not state.phase.closes_in:
        return ''
    bounds = LONGEST_NEARING if _is_nearing(state, measurement) else LONGEST_WAY
    longest = bounds * settings.initial_distance + state.motion.reversed
    if abs(state.motion.travel) > longest:
        return Reason.LONG_WAY.of(longest, name)
    ratio = _excursion(state, measurement)
    if settings.max_excursion == 0.0 or ratio <= settings.max_excursion:
        return ''
    return Reason.EXCURSION.of(name, ratio)


def _is_nearing(state: DriveState, measurement: Measurement) -> bool:
    """Return whether less is left, by the memory of views, than a part of what was driven."""
    if measurement.offset is None:
        return False
    return math.hypot(*measurement.offset) < NEARER * abs(state.motion.travel)


def _excursion(state: DriveState, measurement: Measurement) -> float:
    """
    Return the distance over that at which the leg began; 1 where it is not known.

    What the leg has led backward is left out, up to a metre: near the goal step 1 may need it.
    """
    estimate, leg, bearings = state.view.estimate, state.motion.leg, measurement.bearings
    if estimate is None or leg is None or bearings is None or math.isnan(estimate.range):
        return 1.0
    distance = estimate.range
    x = distance * math.cos(bearings.psi) - leg.x
    y = distance * math.sin(bearings.psi) - leg.y
    backward = min(max(-leg.travel, 0.0), MOST_BACKWARD)
    return (distance - backward) / max(math.hypot(x, y), LEAST_FIRST)
