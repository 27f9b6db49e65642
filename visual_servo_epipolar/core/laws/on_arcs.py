"""
Law ``smooth`` on a base that does not turn in place: one motion, after backing off on an arc.

The law of ``steering`` is simulated ahead, at the bounded curvature, with the features in
view; a base that is steered late drives slower for it, on the same path. A memory of views knows
where the robot is. Where one motion from there would not end on the goal's axis, the robot first
backs off on an arc, that of the least way there and back; what is left aside at the goal cannot be
turned away in place, so that it backs off for it as well. Each motion that ends elsewhere is an
attempt, and those are bounded in number.
"""

from dataclasses import replace
import math
from typing import NamedTuple

import numpy as np

from visual_servo_epipolar.core.arrays import FloatArray
from visual_servo_epipolar.core.bases.car import LAG_WAY
from visual_servo_epipolar.core.estimate.goal_estimate import GoalEstimate, usual_step
from visual_servo_epipolar.core.estimate.settings import DriveSettings
from visual_servo_epipolar.core.geometry.motion import Twist
from visual_servo_epipolar.core.laws import arrival, smooth
from visual_servo_epipolar.core.laws.braking import BRAKING, rate_within
from visual_servo_epipolar.core.laws.machine import StateMachine
from visual_servo_epipolar.core.laws.memory import Backing, Memory
from visual_servo_epipolar.core.laws.phase import Event, Phase
from visual_servo_epipolar.core.laws.steering import GAINS, RESERVE
from visual_servo_epipolar.core.laws.two_steps import FULL

STEP = 0.06  # of a way ahead in thought: part of the distance
STEPS = 110
LEAST_AHEAD = 0.1  # of the goal, on its axis, where the law ends, and its steps get no shorter [m]
WAYS = np.array([0.0, 0.1, 0.2, 0.3, 0.45, 0.6, 0.8, 1.0, 1.3, 1.6, 2.0, 2.5, 3.2, 4.0, 5.0])
BENDS = np.array([0.0, -0.3, 0.3, -0.6, 0.6, -1.0, 1.0])  # of the largest curvature
SPARED = 0.85  # of the largest curvature, by which ways are chosen: the rest undoes errors
MISSED = 4.0  # times what a way may miss the goal by, at which it is given up
FAR = 0.2  # way left for which as much again is tolerated: it is not known as well from there [m]
DECIDED = 0.08  # way left below which the goal itself tells [m]
FACES = 0.01  # heading error of a car that has arrived, where no tolerance is set [rad]
WIDEST = 1.2  # turn that a way takes at most, whatever is in view [rad]
LEAST_BACKING = 0.05  # speed of the last of a way back [m/s]


class GoalOffset(NamedTuple):
    """Places of robots, shape (N,): right and ahead of the goal [m], heading error [rad]."""

    x: FloatArray
    y: FloatArray
    heading: FloatArray


class Bounds(NamedTuple):
    """
    Bounds of a path.

    ``curvature``, the largest [1/m]; ``left`` and ``right``, how far it may turn from the present
    heading so that features stay in view [rad].
    """

    curvature: float
    left: float
    right: float


def moved(place: GoalOffset, way: FloatArray, kappa: FloatArray) -> GoalOffset:
    """Return where ``way`` [m], backward negative, leads on arcs of curvature ``kappa`` [1/m]."""
    turn = kappa * way
    chord = way * np.sinc(0.5 * turn / np.pi)
    middle = place.heading + 0.5 * turn
    return GoalOffset(
        place.x - chord * np.sin(middle), place.y + chord * np.cos(middle), place.heading + turn
    )


def misses(place: GoalOffset, heading: float, bounds: Bounds) -> FloatArray:
    """
    Return by how much the motion from each ``place`` misses the goal: 1 is what it may.

    That is half of what a robot that has arrived may be off.

    ``heading`` is the one that ``bounds`` count their turns from. inf where it begins out of view,
    or past the goal.
    """
    low, high = heading - bounds.right, heading + bounds.left
    lost = (place.heading < low) | (place.heading > high) | (place.y >= 0.0)
    for _ in range(STEPS):
        way = np.minimum(
            STEP * np.maximum(np.hypot(place.x, place.y), LEAST_AHEAD),
            np.maximum(-place.y, 0.0) / np.maximum(np.cos(place.heading), 0.2),
        )
        if not way.any():
            break
        wanted = _curvature(place, low, high)
        place = moved(place, way, np.clip(wanted, -bounds.curvature, bounds.curvature))
    error = 2.0 * np.hypot(place.x / arrival.ARRIVAL_OFFSET, place.heading / FACES)
    return np.where(lost | (place.y < -STEP * LEAST_AHEAD), np.inf, error)


def _curvature(place: GoalOffset, low: float, high: float) -> FloatArray:
    """Return what ``steering`` asks for at each ``place`` [1/m], with features in view."""
    ahead = np.maximum(LEAST_AHEAD + place.y, 0.0)
    distance = np.hypot(place.x, ahead - place.y)
    phi = 0.5 * np.pi - np.arctan2(ahead - place.y, -place.x)
    delta = place.heading + phi
    aim = np.arctan(-GAINS.k1 * phi)
    held = np.clip(aim, low + phi, high + phi)
    rate = GAINS.k1 / (1.0 + (GAINS.k1 * phi) ** 2)
    damping = np.where(held == aim, (1.0 + rate) * np.sin(delta), 0.0)
    return np.asarray(-(GAINS.k2 * (delta - held) + damping) / distance)


def way_back(place: tuple[float, float, float], kappa: float, bounds: Bounds) -> Backing:
    """
    Return the shortest arc backward from ``place`` after which one motion ends at the goal.

    ``kappa`` is the curvature of the present way back [1/m], which costs least to keep.
    """
    bends, ways = (
        item.ravel() for item in np.meshgrid(BENDS * bounds.curvature, WAYS, indexing='ij')
    )
    start = GoalOffset(*(np.full(len(ways), value) for value in place))
    behind = moved(start, -ways, bends)
    missing = misses(behind, place[2], bounds)
    cost = 2.0 * ways + 0.1 * np.abs(bends - kappa) * (ways > 0.0) + np.hypot(behind.x, behind.y)
    cost[missing > 1.0] = np.inf
    best = int(np.argmin(cost))
    return Backing(float(bends[best]), float(ways[best]) if np.isfinite(cost[best]) else np.inf)


def lag_way(way: float) -> float:
    """Return the part of a ``way`` [m] that is lost while the wheels turn."""
    return LAG_WAY * (1.0 - math.exp(-way / LAG_WAY))


def _approaching(goal: GoalEstimate, memory: Memory, settings: DriveSettings) -> Event:
    event = smooth.APPROACHING.classify(goal, memory, settings)
    if event in (Event.MATCHED, Event.TURNED):
        faces = abs(goal.heading_error) <= FACES
        if settings.arrival_heading > arrival.FACING:
            faces = arrival.faces_goal(goal, memory, settings)
        return Event.MATCHED if faces else smooth.missed(memory, settings)
    sight = _sight(goal, settings)
    if event not in (Event.NOTHING, Event.SIDEWAYS) or sight is None:
        return event
    if memory.settling.settled or sight.y > -DECIDED or not settings.options.retreat:
        return Event.NOTHING
    place = GoalOffset(*(np.array([value]) for value in sight))
    missing = float(misses(place, sight.heading, _bounds(goal, settings, 1.0))[0])
    gone = missing > MISSED * (1.0 - sight.y / FAR)
    return smooth.missed(memory, settings) if gone else Event.NOTHING


def _approach(goal: GoalEstimate, memory: Memory, settings: DriveSettings) -> Twist:
    """
    Return the velocity of one motion, which ends on an arc to the goal's heading.

    That begins at the last image from which the wheels, which lag, can still turn the car to it.
    """
    twist, sight = smooth.approach(goal, memory, settings), _sight(goal, settings)
    if sight is None or twist.linear <= 0.0 or not -DECIDED < sight.y < 0.0:
        return twist
    kappa, most = _present_curvature(goal), settings.drive.max_curvature
    way, left = twist.linear * usual_step(goal.period), -sight.y
    wanted = twist.angular / twist.linear
    after = wanted + (kappa - wanted) * math.exp(-way / LAG_WAY)
    heading = sight.heading + 0.5 * (kappa + after) * way
    # The turn against that curvature which the way allows that is left then.
    against, then, sharp = math.copysign(1.0, heading) * after, left - way, SPARED * most
    if abs(heading) < sharp * then - (sharp + against) * lag_way(then):
        return twist
    last = -sight.heading / max(left - lag_way(left), 2.0 * way)
    return replace(twist, angular=min(max(last, -most), most) * twist.linear)


def _retreating(goal: GoalEstimate, memory: Memory, settings: DriveSettings) -> Event:
    backing = memory.law.backing
    if goal.offset is None or backing is None:
        return smooth.retreating(goal, memory, settings)
    if goal.is_untrusted(settings.near_parallax):
        return Event.LOST
    return Event.APART if backing.way == 0.0 else Event.NOTHING


def _retreat(goal: GoalEstimate, memory: Memory, settings: DriveSettings) -> Twist:
    """Return the velocity on the arc backward; by two views alone, as on any base."""
    backing = memory.law.backing
    if backing is None or math.isinf(backing.way) or settings.max_retreat == 0.0:
        return RETREATING_FREELY.command(goal, memory, settings)
    speed = rate_within(
        backing.way, deceleration=BRAKING * settings.max_acceleration, delay=settings.latency
    )
    speed = -min(max(speed, LEAST_BACKING), settings.retreat_speed)
    return Twist(speed, speed * backing.curvature)


def _with_way_back(goal: GoalEstimate, memory: Memory, settings: DriveSettings) -> Memory:
    """Return ``memory`` with the arc to back off on from where the robot is."""
    sight = _sight(goal, settings)
    backing = None
    if sight is not None:
        bounds = _bounds(goal, settings, SPARED)
        backing = way_back(sight, _present_curvature(goal), bounds)
    return memory.changed(backing=backing)


def _sight(goal: GoalEstimate, settings: DriveSettings) -> smooth.Sight | None:
    """Return where the robot will be when it obeys, by a memory of views; None without one."""
    return None if goal.offset is None else smooth.seen_from(goal, settings)


def _bounds(goal: GoalEstimate, settings: DriveSettings, part: float) -> Bounds:
    left, right = (min(max(margin - RESERVE, 0.0), WIDEST) for margin in goal.view_margins)
    return Bounds(part * settings.drive.max_curvature, left, right)


def _present_curvature(goal: GoalEstimate) -> float:
    return goal.twist.angular / goal.twist.linear if goal.twist.linear else 0.0


def _ends(goal: GoalEstimate, memory: Memory, settings: DriveSettings) -> bool:
    """Return whether the motion leads no farther: the heading cannot be turned there."""
    if goal.offset is None:
        return False
    through = smooth.is_through(goal, memory, settings)
    return through or arrival.is_near_enough(goal, memory, settings)


RETREATING_FREELY = smooth.ONE_MOTION.rows[Phase.RETREATING]
ON_ARCS = StateMachine(
    (
        *(row for phase, row in smooth.ONE_MOTION.rows.items() if not phase.turns_in_place),
        replace(
            RETREATING_FREELY,
            classify=_retreating,
            command=_retreat,
            begin=_with_way_back,
            observe=_with_way_back,
        ),
        replace(smooth.APPROACHING, classify=_approaching, command=_approach, is_settled=_ends),
    ),
    # Without a baseline it backs off in place of turning; where it faces aside, it misses.
    {
        (before, event): Phase.RETREATING if after.turns_in_place else after
        for (before, event), after in smooth.ONE_MOTION.transitions.items()
        if not before.turns_in_place and event is not Event.TURNED
    },
)
SMOOTH = replace(FULL, machine=smooth.ONE_MOTION, on_arcs=ON_ARCS)
