"""
Settling: frames in a row that fulfil the aim of a phase, their mean, and moves by pulses.

A base with a dead band ends on its aim so: it stands, measures, and moves once. What is slower
than a dead band is sent as pulses, each of which is a hop of threshold times frame. A move is a
train of them, as long as what is left by the mean since the robot stands. Its hops are stretched
as far as ramps allow, so that a whole number of them leads there. A turn shorter than half a hop
first leads away by one, where that ends nearer. A base that goes back and forth, as
the body nods or the lens breathes, ends in the same way.
"""

from dataclasses import replace
import math
from typing import Any, NamedTuple

from visual_servo_epipolar.core.arrays import ROUNDING
from visual_servo_epipolar.core.bases.base import turns_in_place
from visual_servo_epipolar.core.estimate.base_model import LATENCY_S
from visual_servo_epipolar.core.estimate.dead_band import learns, STANDING
from visual_servo_epipolar.core.estimate.goal_estimate import GoalEstimate, usual_step
from visual_servo_epipolar.core.geometry.motion import Twist
from visual_servo_epipolar.core.geometry.wall import aside
from visual_servo_epipolar.core.laws import arrival
from visual_servo_epipolar.core.laws.conditions import sees_too_little
from visual_servo_epipolar.core.laws.machine import PhaseRow
from visual_servo_epipolar.core.laws.phase import Phase
from visual_servo_epipolar.core.laws.prediction import predicted
from visual_servo_epipolar.core.servo.run_log import AT_GOAL_M, LEAST_REVERSED
from visual_servo_epipolar.core.servo.settings import ServoSettings
from visual_servo_epipolar.core.servo.state import ServoState
from visual_servo_epipolar.core.stamps import seconds_between
from visual_servo_epipolar.core.twoview.measurement import Measurement
from visual_servo_epipolar.core.twoview.observation import Observation

STAND_S = 1.5  # longest look where what it sees swings: two and a move take less than 5 s
SWING = 0.25  # of the scatter of a stand, that its mean may be wrong by


def row_of(state: ServoState, settings: ServoSettings) -> PhaseRow:
    """Return the row of the present phase, of the law that drives."""
    return settings.machine.row(state.phase)


def is_settled(state: ServoState, settings: ServoSettings) -> bool:
    """Return whether this frame fulfils the aim of the phase."""
    settling, goal = state.settling, state.measurement
    if (rest := settling.rest) is not None:
        # Where it swings, its own mean may end the phase, or the one before a move.
        tells = settling.scatter > 0.0 or _has_measured(state, settings)
        return (tells or not settling.swing_s) and _is_settled(rest, state, settings)
    if goal is None or not _is_settled(goal, state, settings):
        return False
    # Commands that have not acted yet must not lead away again.
    ahead = predicted(goal, state.phase, settings)
    return ahead is goal or _is_settled(ahead, state, settings)


def _is_settled(goal: GoalEstimate, state: ServoState, settings: ServoSettings) -> bool:
    """Return whether an estimate fulfils the aim of the phase."""
    if sees_too_little(goal, settings):
        return False
    return row_of(state, settings).is_settled(goal, state, settings)


def is_close(state: ServoState, settings: ServoSettings) -> bool:
    """Return whether this frame is within the usual bounds, where a memory asks for finer ones."""
    goal = state.settling.rest or state.measurement
    return goal is not None and row_of(state, settings).is_close(goal, state, settings)


def settle(
    state: ServoState,
    observation: Observation | None,
    previous: Measurement | None,
    dt: float,
    settings: ServoSettings,
) -> ServoState:
    """Return the state with its count of settled frames, ``dt`` [s] after the ``previous``."""
    state = state.changed(**_rest(state, previous, settings))
    state = _with_swing(state, settings)
    if not (state.phase.drives and dt):  # it may have been moved, and commands be withdrawn
        state = state.changed(stood=None)
    state = _with_dead_band_of_move(state, settings)
    measurement = state.measurement
    offset = None if measurement is None else measurement.offset
    near = offset is not None and math.hypot(*offset) <= AT_GOAL_M  # so that it is to end soon
    state = state.changed(time_at_goal=state.settling.time_at_goal + dt if near else 0.0)
    if is_close(state, settings):
        state = state.changed(time_in_tolerance=state.settling.time_in_tolerance + dt)
    if measurement is None or not is_settled(state, settings):
        return state.changed(settled=0) if state.settling.settled else state
    if state.phase is Phase.HOLDING:  # images in a row come in time after each other
        stamp_ns = measurement.stamp_ns
        gap = 0.0 if previous is None else seconds_between(previous.stamp_ns, stamp_ns)
        if not 0.0 < gap <= settings.stale_timeout:
            state = state.changed(settled=0)
    settled = state.settling.settled + 1
    mean = state.settling.settled_parallax if state.settling.settled else 0.0
    square = mean**2 + (measurement.parallax**2 - mean**2) / settled
    return state.changed(
        settled=settled,
        settled_parallax=math.sqrt(max(square, 0.0)),
        settled_aside=_aside(state, measurement, observation, settings),
    )


def _rest(
    state: ServoState, previous: Measurement | None, settings: ServoSettings
) -> dict[str, Any]:
    """Return the mean of what is measured since the robot stands, in the fields of the state."""
    now, before, settling = state.measurement, state.settling.rest, state.settling
    if (
        now is None
        or not math.isfinite(now.difference)
        or not state.phase.drives
        or not _stands(now, previous, state, settings)
    ):
        moves: dict[str, Any] = {'rest': None, 'rested': 0, 'rest_square': 0.0}
        if not _has_measured(state, settings):
            return moves
        scatter = _scatter(settling.rest_square, settling.rested) if settling.swing_s else 0.0
        return moves | {'stood': before, 'scatter': scatter}
    if before is None or (before.offset is None) is not (now.offset is None):
        return {'rest': now, 'rested': 1, 'rest_square': 0.0}
    rested, change = settling.rested + 1, now.difference - before.difference
    turn = math.remainder(now.heading_error - before.heading_error, 2.0 * math.pi)
    mean = replace(
        now,
        difference=before.difference + change / rested,
        heading_error=before.heading_error + turn / rested,
    )
    if now.offset is not None and before.offset is not None:
        (x, y), (last_x, last_y) = now.offset, before.offset
        mean = replace(
            mean, offset=(last_x + (x - last_x) / rested, last_y + (y - last_y) / rested)
        )
    square = settling.rest_square + change * (now.difference - mean.difference)
    mean = _swinging(mean, max(SWING * _scatter(square, rested), settling.scatter))
    return {'rest': mean, 'rested': rested, 'rest_square': square}


def _swinging(mean: GoalEstimate, swing: float) -> GoalEstimate:
    """
    Return the ``mean`` of a stand whose D may be wrong by as much as it swings.

    That is a part of its scatter; after a move by the mean of a swing, all of that before it.
    """
    if not swing > mean.difference_deviation:
        return mean
    slope = mean.difference_slope
    off = max(mean.offset_deviation, swing / slope) if slope > 0.0 else mean.offset_deviation
    return replace(mean, difference_deviation=swing, offset_deviation=off)


def _scatter(square: float, count: int) -> float:
    """Return the deviation of values by their sum of squares about the mean, and their count."""
    return math.sqrt(square / max(count - 1, 1))


def _stands(
    now: GoalEstimate, previous: Measurement | None, state: ServoState, settings: ServoSettings
) -> bool:
    """
    Return whether the robot stands by its commands, some within its dead bands.

    One of them may be but assumed, and narrower: it stands once images show that too.
    """
    sent, least = state.motion.sent, seen_after(settings)
    if sent.rest_s(now.stamp_ns) >= least:
        return True
    bands = Twist(settings.dead_band_linear, settings.dead_band_angular)
    if sent.rest_s(now.stamp_ns, bands) < least:
        return False
    if state.settling.rest is not None:
        return True
    if previous is None:
        return False
    dt = seconds_between(previous.stamp_ns, now.stamp_ns)
    asked = sent.mean(previous.stamp_ns, now.stamp_ns, 0.0)
    change = STANDING * dt * abs(asked.linear) * _slope(now, state)
    turn = math.remainder(now.heading_error - previous.heading_error, 2.0 * math.pi)
    return abs(now.difference - previous.difference) <= max(
        settings.arrival_difference, change
    ) and abs(turn) <= max(arrival.FACING, STANDING * dt * abs(asked.angular))


def _with_swing(state: ServoState, settings: ServoSettings) -> ServoState:
    """
    Return ``state`` with the time in which the robot goes back and forth, if it follows a swing.

    The body nods, or the lens breathes: the base then ends by pulses, as one with a dead band.
    """
    if not (state.phase.straight or state.phase.turns_in_place):
        return state.changed(scatter=0.0) if state.settling.scatter else state
    if state.settling.swing_s or not learns(settings):
        return state
    # Of a base that ends by pulses, moves back and forth mean little but by the mean of a stand.
    measured = _has_measured(state, settings)
    goal = state.settling.rest if measured else state.measurement
    if goal is None:
        return state
    bound = arrival.matched_bound(goal, state, settings, spent=True)
    steers = not turns_in_place(settings.drive)  # its law goes back once
    by_pulses = settings.dead_band_linear > 0.0 and not (measured or steers)
    swing_s = state.motion.sent.swing_s(
        LEAST_REVERSED['v'],
        begin_ns=state.run.phase_start_ns,  # backing off is none
        pause=seen_after(settings) if by_pulses else math.inf,
        reversals=3 if steers else 2,
    )
    if not swing_s or not abs(goal.difference) > 2.0 * bound:
        return state
    band = state.identified.dead_band.assumed(usual_step(state.view.period), settings)
    return state.changed(swing_s=swing_s, dead_band=band)


def _has_measured(state: ServoState, settings: ServoSettings) -> bool:
    """Return whether the robot has stood for long enough to move by what it sees."""
    rested, swings = state.settling.rested, 4.0 * state.settling.swing_s
    lasted = rested * usual_step(state.view.period)
    return rested >= settings.arrival_frames and lasted >= min(swings, STAND_S)


def _with_dead_band_of_move(state: ServoState, settings: ServoSettings) -> ServoState:
    """Return ``state`` with the dead bands that the last move shows, if any."""
    seen, band = state.settling.rest, state.identified.dead_band
    if seen is None or state.settling.rested != settings.arrival_frames:
        return state
    period, slope = state.view.period, _slope(seen, state)
    if (move := _last_move(seen, state, slope)) is not None:
        band = band.after_move(move.way, move.gone, _mean_error(state, slope), period, settings)
    if (turn := _last_move(seen, state)) is not None:
        band = band.after_turn(turn.way, turn.gone, seen.heading_deviation, period, settings)
    return state.changed(dead_band=band)


def seen_after(settings: ServoSettings) -> float:
    """Return the time after which a motion that was commanded has acted and was seen [s]."""
    return max(2.0 * LATENCY_S, settings.latency + 2.0 * LATENCY_S / 3.0)


def _aside(
    state: ServoState, goal: GoalEstimate, seen: Observation | None, settings: ServoSettings
) -> float:
    """Return the mean by which settled frames look aside, for want of a better estimate."""
    settling = state.settling
    before = settling.settled_aside if settling.settled else 0.0
    if seen is None or not state.phase.straight or not arrival.is_in_doubt(goal, settings):
        return before
    return before + (aside(seen.current, seen.desired) - before) / (state.settling.settled + 1)


class Aim(NamedTuple):
    """
    What is ``left`` to the aim, the ``bound`` within which it is met, and the ``error`` of both.

    ``threshold`` is the dead band, ``ramp`` by how much the next pulse may be faster, ``limit``
    the fastest one; ``acceleration`` that by which the base speeds up to the threshold, and
    ``room`` what a move may lead away to come back, to the positive and to the negative side.
    [m, m/s, m/s^2] or [rad, rad/s, rad/s^2]
    """

    left: float
    bound: float
    threshold: float
    ramp: float
    limit: float
    error: float = 0.0
    acceleration: float = math.inf
    room: tuple[float, float] = (0.0, 0.0)


def pulsed_move(
    wanted: Twist, state: ServoState, settings: ServoSettings
) -> tuple[Twist, Twist] | None:
    """
    Return the twist to command for the one ``wanted``, and the rest of the move [m/s, rad/s].

    None where the law goes on: the base follows, the aim is farther than it drives while a move
    is waited for, or its place is unknown.
    """
    seen, rest = state.settling.rest or state.measurement, state.dead_band_residual
    steers = not turns_in_place(settings.drive)  # on its way alone: it ends by where it drives
    if seen is None or settings.dead_band_mode != 'pulse':
        return None
    if steers and not state.settling.swing_s:
        return None
    slope = _slope(seen, state)
    ends_straight = state.phase.straight and slope > 0.0
    if not (ends_straight or state.phase.turns_in_place):
        return None
    turn = None if steers else _pulsed_turn(wanted.angular, seen, rest.angular, state, settings)
    if not ends_straight:
        return None if turn is None else (Twist(0.0, turn[0]), Twist(0.0, turn[1]))
    left, band = -seen.difference / slope, settings.dead_band_linear
    bound = arrival.matched_bound(seen, state, settings) / slope
    moves = _moves(rest.linear, band)
    swings = band > 0.0 and state.settling.swing_s > 0.0
    near = abs(left) <= max(band * seen_after(settings), AT_GOAL_M if swings else 0.0)
    if not moves and ((abs(wanted.linear) >= band and not swings) or not near):
        return None
    if not moves and abs(left) <= bound and not turn:  # there, but it may have to turn
        return settings.drive.beyond_dead_band(Twist(0.0, wanted.angular), rest, mode='pulse')
    aim = Aim(
        left,
        bound,
        band,
        settings.max_acceleration * usual_step(state.view.period),
        settings.max_speed_ratio * settings.max_linear,
        _mean_error(state, slope),
        _acceleration(left, seen, slope, state, settings),
    )
    speed, more = _next_pulse(aim, rest.linear, state.twist.linear, state, settings)
    awaits = abs(left) > bound and not (speed or _moves(rest.angular, settings.dead_band_angular))
    turn = (0.0, 0.0) if turn is None or awaits else turn  # one move, not two
    return Twist(speed, turn[0]), Twist(more, turn[1])


def _slope(seen: GoalEstimate, state: ServoState) -> float:
    """Return the slope of D by the map or by two views [1/m]; nan while unknown."""
    slope = seen.difference_slope
    return slope if slope > 0.0 else state.motion.slope.value


def _mean_error(state: ServoState, slope: float) -> float:
    """Return the error [m] of the mean of what is measured since the robot stands."""
    settling = state.settling
    return math.sqrt(settling.rest_square) / max(settling.rested - 1, 1) / slope


def _pulsed_turn(
    wanted: float, seen: GoalEstimate, moving: float, state: ServoState, settings: ServoSettings
) -> tuple[float, float] | None:
    """
    Return the next pulse to the goal's heading with ``moving`` left, and the rest [rad/s].

    None where the law turns faster and the robot does not stand, or its heading is of two views.
    """
    band, stands = settings.dead_band_angular, state.settling.rested > 0
    if seen.offset is None or not band:
        return None
    if abs(wanted) >= band and not (stands or _moves(moving, band)):
        return None
    bound = arrival.facing_bound(seen, state, settings)
    ramp = settings.max_angular_acceleration * usual_step(state.view.period)
    limit = settings.max_speed_ratio * settings.max_angular
    aim = Aim(-seen.heading_error, bound, band, ramp, limit, room=seen.view_margins)
    return _next_pulse(aim, moving, state.twist.angular, state, settings)


def _moves(left: float, threshold: float) -> bool:
    """Return whether a move goes on, of which so much is ``left`` [m/s, rad/s]."""
    return abs(left) >= threshold * (1.0 - ROUNDING) > 0.0


def _hops(moving: float, threshold: float) -> int:
    """Return how many pulses of at least the ``threshold`` add up to ``moving``."""
    return math.floor(abs(moving) / threshold * (1.0 + ROUNDING))


def _next_pulse(
    aim: Aim, moving: float, now: float, state: ServoState, settings: ServoSettings
) -> tuple[float, float]:
    """Return the pulse after that of ``now`` of a move with ``moving`` left, and the rest."""
    # A ramp above the dead band.
    most = min(max(aim.threshold, abs(now)) + aim.ramp, max(aim.limit, aim.threshold))
    if not _moves(moving, aim.threshold):  # the last one is over
        # What the mean may be wrong by is no reason to move.
        measured = _has_measured(state, settings) and aim.error <= aim.bound
        frame_s = usual_step(state.view.period)
        way = way_of_move(aim.left, aim.bound, aim.threshold * frame_s, aim.room)
        moving = _pulses(way, aim, frame_s, most) if measured and way else 0.0
    quick = aim.ramp if math.isinf(aim.acceleration) else 0.0
    pulse = first_pulse(moving, aim.threshold, most, ramp=quick)
    return pulse, moving - pulse


def _pulses(way: float, aim: Aim, frame_s: float, most: float) -> float:
    """
    Return the sum of the pulses of a ``way``, of a base that slows down twice as fast.

    None is above ``most``: where one more of the least ends nearer, the train has one more.
    """
    least, acceleration = aim.threshold, aim.acceleration
    if abs(way) <= least * frame_s:
        return math.copysign(least, way)
    if abs(way) < 0.75 * least * least / acceleration:
        # It never reaches the speed of its pulses: how long they last decides.
        hops = round(math.sqrt(abs(way) / (0.75 * acceleration)) / frame_s)
        return math.copysign(max(hops, 1) * least, way)
    moving = abs(way) / frame_s + least * least / (4.0 * acceleration * frame_s)
    hops = _hops(moving, least)
    if (hops + 1) * least - moving < moving - hops * most:
        moving = (hops + 1) * least
    return math.copysign(moving, way)


class Move(NamedTuple):
    """Move between two stands: its ``way`` as sent, what was ``gone`` of it, and how long [s]."""

    way: float
    gone: float
    lasted: float


def _last_move(seen: GoalEstimate, state: ServoState, slope: float | None = None) -> Move | None:
    """
    Return the last move, which led to what is ``seen``; None if there was none, or to and fro.

    Along the axis by the ``slope`` of D [m]; without one that of the heading [rad].
    """
    stood, sent = state.settling.stood, state.motion.sent
    if stood is None or not sent.stamps or sent.stamps[0] > stood.stamp_ns:
        return None
    if slope is not None:
        change = (seen.difference - stood.difference) / slope if slope > 0.0 else math.nan
    elif seen.offset is not None:
        change = math.remainder(seen.heading_error - stood.heading_error, 2.0 * math.pi)
    else:
        change = math.nan
    acting = sent.acting(stood.stamp_ns, seen.stamp_ns, 0.0)
    parts = [(span, twist.angular if slope is None else twist.linear) for span, twist in acting]
    spans = [(span, speed) for span, speed in parts if speed]
    way = math.fsum(span * speed for span, speed in spans)
    if math.isnan(change) or not way or min(way * speed for _, speed in spans) < 0.0:
        return None
    lasted = math.fsum(span for span, _ in spans)
    return Move(abs(way), math.copysign(1.0, way) * change, lasted)


def _acceleration(
    left: float, seen: GoalEstimate, slope: float, state: ServoState, settings: ServoSettings
) -> float:
    """
    Return the acceleration by which the base began its last move [m/s^2], by where that ended.

    Before a move it is twice that of the ramps, and so large that even a base without ramps ends
    no farther past what is ``left`` [m] than by half of it.
    """
    least, move = settings.max_acceleration, _last_move(seen, state, slope)
    if move is None:
        return max(2.0 * least, 0.6 * settings.dead_band_linear**2 / max(abs(left), 1e-9))
    way, gone, lasted = move
    if gone >= way:
        return math.inf
    if gone >= 0.75 * way:
        return max((way / lasted) ** 2 / (4.0 * (way - gone)), least)
    return max(gone / (0.75 * lasted**2), least)


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
    if abs(left) >= 0.5 * hop or not any(room):
        return math.copysign(hop, left)
    return math.copysign(hop, -left) if hop <= room[left > 0.0] else 0.0


def first_pulse(moving: float, threshold: float, most: float, *, ramp: float = 0.0) -> float:
    """
    Return the first of pulses, of at least the ``threshold``, that add up to ``moving``.

    They are alike and as small as can be; or, of a base that follows a ``ramp``, as few as slow
    down to the threshold by two of them from pulse to pulse.
    """
    hops, way, falls = _hops(moving, threshold), abs(moving), 0
    if not hops:
        return 0.0
    if ramp:
        first = threshold + ramp
        falls = math.ceil((math.sqrt(first**2 + 4.0 * ramp * way) - first) / (2.0 * ramp))
        hops = min(hops, max(falls, math.ceil(way / most)))
    pulse = way / hops
    if hops == falls:  # it is the fastest: those after it slow down all along
        pulse *= (threshold + 2.0 * ramp * hops) / (threshold + ramp * (hops + 1))
        pulse = min(pulse, way - (hops - 1) * threshold)
    return math.copysign(min(pulse, most), moving)
