"""
Moves by pulses: a base with a dead band stands, measures, and moves once onto its aim.

What is slower than a dead band is sent as pulses, each of which is a hop of threshold times frame.
A move is a train of them, as long as what is left by the mean since the robot stands. Its hops are
stretched, so that a whole number of them leads there, as far as ramps from the dead band on allow
it. A turn that is shorter than one hop first
leads away by one, where that ends nearer.
"""

import math
from typing import NamedTuple

from visual_servo_epipolar.core.bases.base import turns_in_place
from visual_servo_epipolar.core.geometry.motion import Twist
from visual_servo_epipolar.core.laws.phases.bounds import facing_bound, matched_bound, trial_of
from visual_servo_epipolar.core.servo.settings import ServoSettings
from visual_servo_epipolar.core.servo.settling import seen_after
from visual_servo_epipolar.core.servo.state import ServoState

ROUNDING = 1e-9  # of a sum of hops


class Aim(NamedTuple):
    """
    What is ``left`` to the aim, the ``bound`` within which it is met, and the ``error`` of both.

    ``threshold`` is the dead band, ``lost`` what speeding up to it takes of a move, and ``room``
    what a move may lead away to come back, to the positive and to the negative side. [m, m/s] or
    [rad, rad/s]
    """

    left: float
    bound: float
    threshold: float
    error: float = 0.0
    lost: float = 0.0
    room: tuple[float, float] = (0.0, 0.0)


def pulsed_move(
    wanted: Twist, state: ServoState, settings: ServoSettings
) -> tuple[Twist, Twist] | None:
    """
    Return the twist to command for the one ``wanted``, and the rest of the move [m/s, rad/s].

    None where the law goes on: the base follows, the aim is farther than it drives while a move
    is waited for, or its place is unknown.
    """
    seen, rest = state.settling.rest or state.measurement, state.motion.dead_band_residual
    if seen is None or settings.dead_band_mode != 'pulse' or not turns_in_place(settings.drive):
        return None
    if state.phase.turns_in_place and seen.offset is not None:
        bound = facing_bound(seen, settings, trial_of(state))
        aim = Aim(-seen.heading_error, bound, settings.dead_band_angular, room=seen.view_margins)
        if abs(wanted.angular) >= aim.threshold:
            return None
        ramp = settings.max_angular_acceleration * trial_of(state).frame_s
        most = min(max(aim.threshold, abs(state.twist.angular)) + ramp, settings.max_angular)
        turn, more = _next_pulse(aim, rest.angular, most, state, settings)
        return Twist(0.0, turn), Twist(0.0, more)
    slope, settling = seen.difference_slope or state.motion.slope.value, state.settling
    if state.phase.turns_in_place or not slope > 0.0:
        return None
    bound = matched_bound(seen, settings, trial_of(state)) / slope
    error = math.sqrt(settling.rest_square) / max(settling.rested - 1, 1) / slope
    # It slows down twice as fast as it speeds up; if it is faster than its ramps, less is lost.
    lost = 0.5 * settings.dead_band_linear**2 / (4.0 * settings.max_acceleration)
    aim = Aim(-seen.difference / slope, bound, settings.dead_band_linear, error, lost)
    near = state.phase.straight and abs(aim.left) <= aim.threshold * seen_after(settings)
    if abs(wanted.linear) >= aim.threshold or not near:
        return None
    moves = abs(rest.linear) >= aim.threshold * (1.0 - ROUNDING)
    if not moves and abs(aim.left) <= bound:  # there, but it may have to turn
        return settings.drive.beyond_dead_band(Twist(0.0, wanted.angular), rest, mode='pulse')
    ramp = settings.max_acceleration * trial_of(state).frame_s
    most = min(max(aim.threshold, abs(state.twist.linear)) + ramp, settings.max_linear)
    speed, more = _next_pulse(aim, rest.linear, most, state, settings)
    return Twist(speed, 0.0), Twist(more, 0.0)


def _next_pulse(
    aim: Aim, moving: float, most: float, state: ServoState, settings: ServoSettings
) -> tuple[float, float]:
    """Return the next pulse of a move with ``moving`` left, or of a new one; and the rest."""
    if abs(moving) < aim.threshold * (1.0 - ROUNDING):  # the last move is over
        # What the mean may be wrong by is no reason to move.
        measured = state.settling.rested >= settings.arrival_frames and aim.error <= aim.bound
        frame_s = trial_of(state).frame_s
        way = way_of_move(aim.left, aim.bound, aim.threshold * frame_s, aim.room)
        moving = (way + math.copysign(aim.lost, way)) / frame_s if measured and way else 0.0
    pulse = first_pulse(moving, aim.threshold, most)
    return pulse, moving - pulse


def way_of_move(left: float, bound: float, hop: float, room: tuple[float, float]) -> float:
    """
    Return the way of the next move [m, rad] to an aim that is ``left``, within a ``bound``.

    None is shorter than a ``hop``. ``room`` is how far it may lead away, to the positive side and
    to the negative one.
    """
    if abs(left) <= bound:
        return 0.0
    if abs(left) >= hop:
        return left
    if hop - abs(left) <= bound or not any(room):
        return math.copysign(hop, left)
    return math.copysign(hop, -left) if hop <= room[left > 0.0] else 0.0


def first_pulse(moving: float, threshold: float, most: float) -> float:
    """Return the first of the pulses that add up to ``moving``, all of which are alike."""
    hops = math.floor(abs(moving) / threshold * (1.0 + ROUNDING))
    return math.copysign(min(abs(moving) / hops, most), moving) if hops else 0.0
