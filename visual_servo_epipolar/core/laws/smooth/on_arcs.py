"""
Law ``smooth`` on a base that does not turn in place: one motion, after backing off on an arc.

A memory of views knows where the robot is. Where one motion from there would not end at the goal,
as ``arcs`` drives it ahead, the robot backs off on the arc from which it does; what is left aside
at the goal cannot be turned away in place, so that it backs off for it as well. Each motion that
ends elsewhere is an attempt, and those are bounded in number.
"""

from dataclasses import replace
import math

import numpy as np

from visual_servo_epipolar.core.estimate.settings import DriveSettings
from visual_servo_epipolar.core.geometry.motion import Twist
from visual_servo_epipolar.core.laws.braking import BRAKING, rate_within
from visual_servo_epipolar.core.laws.machine import StateMachine
from visual_servo_epipolar.core.laws.phase import Event, Phase
from visual_servo_epipolar.core.laws.phases.arrival import faces_goal, is_near_enough
from visual_servo_epipolar.core.laws.phases.bounds import FACING
from visual_servo_epipolar.core.laws.phases.conditions import is_untrusted
from visual_servo_epipolar.core.laws.smooth.approach import approach, seen_from, Sight
from visual_servo_epipolar.core.laws.smooth.arcs import (
    Bounds,
    GoalOffset,
    lag_way,
    lagged,
    misses,
    turned_back,
    way_back,
)
from visual_servo_epipolar.core.laws.smooth.phases import (
    APPROACHING,
    is_through,
    missed,
    motion_trial,
    ONE_MOTION,
    retreating,
)
from visual_servo_epipolar.core.laws.smooth.steering import RESERVE
from visual_servo_epipolar.core.laws.state import ServoState
from visual_servo_epipolar.core.laws.timing import usual_step
from visual_servo_epipolar.core.laws.two_steps.two_steps import FULL
from visual_servo_epipolar.core.perception.measurement import Measurement

SPARED = 0.85  # of the largest curvature, by which ways are chosen: the rest undoes errors
MISSED = 4.0  # times what a way may miss the goal by, at which it is given up
FAR = 0.2  # way left for which as much again is tolerated: it is not known as well from there [m]
DECIDED = 0.08  # way left below which the goal itself tells [m]
FACES = 0.01  # heading error of a car that has arrived, where no tolerance is set [rad]
WIDEST = 1.2  # turn that a way takes at most, whatever is in view [rad]
LEAST_BACKING = 0.05  # speed of the last of a way back [m/s]


def _approaching(state: ServoState, measurement: Measurement, settings: DriveSettings) -> Event:
    event = APPROACHING.classify(state, measurement, settings)
    if event in (Event.MATCHED, Event.TURNED):
        faces = abs(measurement.heading_error) <= FACES
        if settings.arrival_heading > FACING:
            faces = faces_goal(state, measurement, settings)
        return Event.MATCHED if faces else missed(state, settings)
    sight = _sight(state, measurement, settings)
    if event not in (Event.NOTHING, Event.SIDEWAYS) or sight is None:
        return event
    if state.settling.settled or sight.y > -DECIDED or not settings.options.retreat:
        return Event.NOTHING
    tolerated = MISSED * (1.0 - sight.y / FAR)
    gone = _misses(sight, measurement, settings) > tolerated
    return missed(state, settings) if gone else Event.NOTHING


def _approach(state: ServoState, measurement: Measurement, settings: DriveSettings) -> Twist:
    """
    Return the velocity of one motion, which ends on an arc to the goal's heading.

    That begins at the last image from which the wheels, which lag, can still turn the car to it.
    """
    twist, sight = approach(state, measurement, settings), _sight(state, measurement, settings)
    if sight is None or twist.linear <= 0.0 or not -DECIDED < sight.y < 0.0:
        return twist
    kappa, most = _present_curvature(state), settings.drive.max_curvature
    way, left = twist.linear * usual_step(state), -sight.y
    after = lagged(kappa, twist.angular / twist.linear, way)
    heading = sight.heading + 0.5 * (kappa + after) * way
    undone = turned_back(math.copysign(1.0, heading) * after, left - way, SPARED * most)
    if abs(heading) < undone:
        return twist
    last = -sight.heading / max(left - lag_way(left), 2.0 * way)
    return replace(twist, angular=min(max(last, -most), most) * twist.linear)


def _retreating(state: ServoState, measurement: Measurement, settings: DriveSettings) -> Event:
    backing = state.law.backing
    if measurement.offset is None or backing is None:
        return retreating(state, measurement, settings)
    if is_untrusted(measurement, settings):
        return Event.LOST
    return Event.APART if backing.way == 0.0 else Event.NOTHING


def _retreat(state: ServoState, measurement: Measurement, settings: DriveSettings) -> Twist:
    """Return the velocity on the arc backward; by two views alone, as on any base."""
    backing = state.law.backing
    if backing is None or math.isinf(backing.way) or settings.max_retreat == 0.0:
        return RETREATING_FREELY.command(state, measurement, settings)
    speed = rate_within(
        backing.way, deceleration=BRAKING * settings.max_acceleration, delay=settings.latency
    )
    speed = -min(max(speed, LEAST_BACKING), settings.retreat_speed)
    return Twist(speed, speed * backing.curvature)


def _with_way_back(
    state: ServoState, measurement: Measurement, settings: DriveSettings
) -> ServoState:
    """Return ``state`` with the arc to back off on from where the robot is."""
    sight = _sight(state, measurement, settings)
    backing = None
    if sight is not None:
        bounds = _bounds(measurement, settings, SPARED)
        backing = way_back(sight, _present_curvature(state), bounds)
    return state.changed(backing=backing)


def _sight(state: ServoState, measurement: Measurement, settings: DriveSettings) -> Sight | None:
    """Return where the robot will be when it obeys, by a memory of views; None without one."""
    if measurement.offset is None:
        return None
    return seen_from(state, measurement, settings)


def _misses(sight: Sight, measurement: Measurement, settings: DriveSettings) -> float:
    """Return by how much the motion from here misses the goal: 1 is what it may."""
    place = GoalOffset(*(np.array([value]) for value in sight))
    bounds = _bounds(measurement, settings, 1.0)
    return float(misses(place, sight.heading, bounds)[0])


def _bounds(measurement: Measurement, settings: DriveSettings, part: float) -> Bounds:
    left, right = (min(max(margin - RESERVE, 0.0), WIDEST) for margin in measurement.view_margins)
    return Bounds(part * settings.drive.max_curvature, left, right)


def _present_curvature(state: ServoState) -> float:
    return state.twist.angular / state.twist.linear if state.twist.linear else 0.0


def _ends(state: ServoState, measurement: Measurement, settings: DriveSettings) -> bool:
    """Return whether the motion leads no farther: the heading cannot be turned there."""
    if measurement.offset is None:
        return False
    through = is_through(state, measurement, settings, motion_trial(state))
    return through or is_near_enough(state, measurement, settings)


RETREATING_FREELY = ONE_MOTION.rows[Phase.RETREATING]
ON_ARCS = StateMachine(
    (
        *(row for phase, row in ONE_MOTION.rows.items() if not phase.turns_in_place),
        replace(
            RETREATING_FREELY,
            classify=_retreating,
            command=_retreat,
            begin=_with_way_back,
            observe=_with_way_back,
        ),
        replace(APPROACHING, classify=_approaching, command=_approach, is_settled=_ends),
    ),
    # Without a baseline it backs off in place of turning; where it faces aside, it has missed.
    {
        (before, event): Phase.RETREATING if after.turns_in_place else after
        for (before, event), after in ONE_MOTION.transitions.items()
        if not before.turns_in_place and event is not Event.TURNED
    },
)
SMOOTH = replace(FULL, machine=ONE_MOTION, on_arcs=ON_ARCS)
