"""
Conditions on a measurement: the predicates that its bounds decide.

``events`` classifies by them, ``switch`` and ``derived_gains`` take the displacement from them.
"""

import math

from visual_servo_epipolar.core.geometry.epipolar import Bearings
from visual_servo_epipolar.core.laws import equations
from visual_servo_epipolar.core.laws.phases.arrival import faces_goal, is_near_enough
from visual_servo_epipolar.core.laws.phases.bounds import (
    align_bound,
    engage_bound,
    is_matched,
    release_bound,
    trial_of,
    trimming_bound,
)
from visual_servo_epipolar.core.laws.phases.table import Phase
from visual_servo_epipolar.core.perception.measurement import Measurement
from visual_servo_epipolar.core.servo.anticipation import anticipated
from visual_servo_epipolar.core.servo.identification.ranging import look_ahead, UNKNOWN_RANGE
from visual_servo_epipolar.core.servo.settings import ServoSettings
from visual_servo_epipolar.core.servo.state import ServoState

RESIDUAL_OFFSET = 1e-3  # at the end of line following [m]
LARGEST_ESCAPE = 0.1  # [rad]
LONGEST_WAY = 1.5  # in upper bounds of the distance
MOST_BACKWARD = 1.0  # of a leg, that is no excursion [m]
CORRECTION = 0.1  # backward, of who never backs off [m]
LEADING_AWAY = 1.5  # what a law without retreat may drive backward, in that of others
LEAST_FIRST = 0.5  # distance that a ratio of distances refers to at least [m]
TURNED = 1.0  # more than a robot turns between two images, or while it stands [rad]
ROOM = 0.18  # behind a goal whose place is known, to begin step 1 [m]
KNOWN = 0.009  # deviation of its bearing from there [rad]
LEAST_RATIO = 1e-9  # part of the distance that a law without retreat keeps


def escape_bound(state: ServoState, measurement: Measurement, settings: ServoSettings) -> float:
    """
    Return the bearing of e_du [rad] beyond which step 1 has to begin anew.

    Line following shrinks an offset x by exp(0.9 d / L) over the remaining distance d: one that
    ends below a millimetre need not be zeroed first, as when a camera ahead of the axle swings
    aside while the robot turns.
    """
    bound = release_bound(measurement, settings)
    if not settings.options.line_following:
        return bound
    distance = state.range if state.range > 0.0 else min(state.distance, UNKNOWN_RANGE)
    decay = min(equations.LINE_DAMPING * distance / look_ahead(distance, settings.look_ahead), 9.0)
    return max(bound, min(RESIDUAL_OFFSET * math.exp(decay) / distance, LARGEST_ESCAPE))


def is_sideways(measurement: Measurement, settings: ServoSettings) -> bool:
    """
    Return whether a law with retreat backs off before step 1.

    From beside or past the goal, and where the field of view leaves no room for a displacement
    that would bring the robot onto the axis before it is at the goal.
    """
    return _backs_off(measurement, settings, settings.least_spiral_ratio)


def is_off_course(measurement: Measurement, settings: ServoSettings) -> bool:
    """Return whether step 1, once begun, is given up for a retreat: with a hysteresis."""
    return _backs_off(measurement, settings, settings.least_spiral_ratio**2)


def _backs_off(measurement: Measurement, settings: ServoSettings, least_ratio: float) -> bool:
    """Return whether the goal is not ahead, or the spiral ends below ``least_ratio``."""
    bearings, law = measurement.bearings, settings.options
    if not law.retreat or bearings is None:
        return False
    if not is_behind(bearings) or abs(bearings.chi) > settings.sideways_bearing:
        return True
    if not law.discordant_turn:
        return False
    return displacement(measurement, settings, least_ratio=least_ratio) is None


def is_far_enough(measurement: Measurement, settings: ServoSettings) -> bool:
    """Return whether there is room for step 1; who remembers where the goal is needs less."""
    known = measurement.deviation <= KNOWN
    if measurement.offset is not None and measurement.offset[1] <= -ROOM and known:
        return True
    return measurement.difference <= -settings.retreat_difference


def has_run_up(state: ServoState, measurement: Measurement, settings: ServoSettings) -> bool:
    """
    Return whether a retreat after a miss has led as far as that asks for.

    Who missed twice knows less of where the goal is than it believes: before a wall, straight
    back, a short way tells hardly what is aside.
    """
    misses = state.attempts - 1
    return misses < 2 or measurement.difference <= -misses * settings.retreat_difference


def is_behind(bearings: Bearings) -> bool:
    """Return whether the robot is behind the goal and has it ahead."""
    return bearings.sigma < 0.0 and math.sin(bearings.psi) < 0.0


def displacement(
    measurement: Measurement, settings: ServoSettings, *, least_ratio: float | None = None
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


def discordant_bearing(measurement: Measurement, settings: ServoSettings) -> float:
    """
    Return the bearing of e_au [rad] for DISPLACING, 0 where there is none.

    A law without retreat takes what the field of view allows, however near the goal the spiral
    ends: it has no other way to begin.
    """
    least_ratio = None if settings.options.retreat else LEAST_RATIO
    return displacement(measurement, settings, least_ratio=least_ratio) or 0.0


def leads_away(measurement: Measurement, settings: ServoSettings) -> bool:
    """
    Return whether both epipoles are on one side, from where step 1 drives away from the goal.

    e_au is turned to the other side first, but on the sign that e_du had then: it may have been
    lost in noise, or that of a mount that was taken for another.
    """
    law, bearings = settings.options, measurement.bearings
    if bearings is None or not (law.discordant_turn and law.retreat):
        return False
    known = abs(bearings.chi) > release_bound(measurement, settings)
    return known and bearings.alpha * bearings.chi > 0.0


def sees_too_little(measurement: Measurement, settings: ServoSettings) -> bool:
    """Return whether too few features are in view, and no memory of views carries on."""
    return measurement.features < settings.min_features and not measurement.carried


def is_untrusted(measurement: Measurement, settings: ServoSettings) -> bool:
    """Return whether D is unknown, or the goal is not near and its bearing not trusted."""
    untrusted = measurement.bearings is None and measurement.parallax > settings.near_parallax
    return untrusted or not math.isfinite(measurement.difference)


def has_turned(state: ServoState, measurement: Measurement) -> bool:
    """Return whether the heading is not that of the last trusted image, by far."""
    turn = math.remainder(measurement.heading_error - state.trusted_heading, 2.0 * math.pi)
    return abs(turn) > TURNED


def is_settled(state: ServoState, settings: ServoSettings) -> bool:
    """Return whether this frame fulfils the aim of the phase."""
    if not _is_settled(state, settings):
        return False
    # Commands that have not acted yet must not lead away again.
    ahead = anticipated(state, settings)
    return ahead is state or _is_settled(ahead, settings)


def _is_settled(state: ServoState, settings: ServoSettings) -> bool:
    """Return whether the measurement of ``state`` fulfils the aim of the phase."""
    measurement = state.measurement
    if measurement is None or sees_too_little(measurement, settings):
        return False
    if state.phase is Phase.HOLDING:
        return not is_untrusted(measurement, settings)
    if state.phase is Phase.ORIENTING:
        return faces_goal(state, measurement, settings)
    if state.phase is Phase.MATCHING_FEATURES:
        matched = is_matched(measurement, settings, trial_of(state))
        return matched or is_near_enough(state, measurement, settings)
    if (
        state.phase is Phase.ZEROING_EPIPOLES
        and state.latched
        and measurement.bearings is not None
    ):
        return abs(measurement.bearings.alpha) <= align_bound(measurement, settings)
    return False


def is_close(state: ServoState, settings: ServoSettings) -> bool:
    """Return whether this frame is within the usual bounds, where a memory asks for finer ones."""
    measurement = state.measurement
    if measurement is None or state.phase not in (Phase.ORIENTING, Phase.MATCHING_FEATURES):
        return False
    if state.phase is Phase.ORIENTING:
        bound = trimming_bound(measurement, settings, trial_of(state))
        return abs(measurement.heading_error) <= bound
    return is_matched(measurement, settings, trial_of(state, spent=True))


def astray(state: ServoState, measurement: Measurement, settings: ServoSettings) -> str:
    """
    Return in words that the robot is farther from the goal than its run may lead it.

    What is driven backward has a bound of its own, over all phases and attempts; who may not back
    off at all corrects by decimetres near the goal, no more. Laws without
    retreat, whose first step may lead away by itself, have a wider one. In steps 1 and 2 of a law
    that spirals inwards the distance hardly grows, and no way is longer than its upper bound
    allows.
    """
    name, law = state.phase.value, settings.options
    backward, wider = state.reversed, 1.0 if law.retreat else LEADING_AWAY
    if settings.max_retreat == 0.0 and state.phase is Phase.RETREATING:
        return (
            'the robot would have to back off, and max_retreat is 0; begin farther away and in '
            'front of the goal, or give it the metres of free floor behind the robot'
        )
    if backward > wider * max(settings.max_retreat, CORRECTION):
        return f'drove {backward:.1f} m backward in this run (max_retreat), still {name}'
    spirals = law.discordant_turn and law.retreat  # laws without lead away first
    if not spirals or state.phase not in (Phase.ZEROING_EPIPOLES, Phase.MATCHING_FEATURES):
        return ''
    longest = LONGEST_WAY * settings.initial_distance
    if abs(state.travel) > longest:
        return f'drove {longest:.0f} m in {name} and is not there (initial_distance)'
    ratio = _excursion(state, measurement)
    if settings.max_excursion == 0.0 or ratio <= settings.max_excursion:
        return ''
    return f'{name} leads away from the goal: {ratio:.1f} times the distance (max_excursion)'


def _excursion(state: ServoState, measurement: Measurement) -> float:
    """
    Return the distance over that at which the leg began; 1 where it is not known.

    What the leg has led backward is left out, up to a metre: near the goal step 1 may need it.
    """
    extrinsics, leg, bearings = state.extrinsics, state.leg, measurement.bearings
    if extrinsics is None or leg is None or bearings is None or not extrinsics.is_ranged:
        return 1.0
    distance = extrinsics.distance
    x = distance * math.cos(bearings.psi) - leg.x
    y = distance * math.sin(bearings.psi) - leg.y
    backward = min(max(-leg.travel, 0.0), MOST_BACKWARD)
    return (distance - backward) / max(math.hypot(x, y), LEAST_FIRST)
