"""Excursion: how far a run may lead away from the goal, and backward."""

import math

from visual_servo_epipolar.core.estimate.settings import DriveSettings
from visual_servo_epipolar.core.laws.state import ServoState
from visual_servo_epipolar.core.perception.measurement import Measurement
from visual_servo_epipolar.core.reasons import Reason

LONGEST_WAY = 1.5  # in upper bounds of the distance
LONGEST_NEARING = 3.0  # the same of who has come nearer, by its memory: it began beyond the bound
NEARER = 0.5  # of what was driven, that is left
MOST_BACKWARD = 1.0  # of a leg, that is no excursion [m]
CORRECTION = 0.1  # backward, of who never backs off [m]
LEADING_AWAY = 1.5  # what a law without retreat may drive backward, in that of others
LEAST_FIRST = 0.5  # distance that a ratio of distances refers to at least [m]


def excursion_limit(state: ServoState, measurement: Measurement, settings: DriveSettings) -> str:
    """
    Return in words that the robot is farther from the goal than its run may lead it.

    What is driven backward has a bound of its own, over all phases and attempts; who may not back
    off at all corrects by decimetres near the goal, no more. Laws without
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


def _is_nearing(state: ServoState, measurement: Measurement) -> bool:
    """Return whether less is left, by the memory of views, than a part of what was driven."""
    if measurement.offset is None:
        return False
    return math.hypot(*measurement.offset) < NEARER * abs(state.motion.travel)


def _excursion(state: ServoState, measurement: Measurement) -> float:
    """
    Return the distance over that at which the leg began; 1 where it is not known.

    What the leg has led backward is left out, up to a metre: near the goal step 1 may need it.
    """
    extrinsics, leg, bearings = state.identified.extrinsics, state.motion.leg, measurement.bearings
    if extrinsics is None or leg is None or bearings is None or not extrinsics.is_ranged:
        return 1.0
    distance = extrinsics.distance
    x = distance * math.cos(bearings.psi) - leg.x
    y = distance * math.sin(bearings.psi) - leg.y
    backward = min(max(-leg.travel, 0.0), MOST_BACKWARD)
    return (distance - backward) / max(math.hypot(x, y), LEAST_FIRST)
