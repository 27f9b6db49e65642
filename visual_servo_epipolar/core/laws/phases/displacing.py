"""Displacing: the turn in place that brings e_au to where step 1 can begin."""

import math

from visual_servo_epipolar.core.estimate.settings import DriveSettings
from visual_servo_epipolar.core.geometry.motion import STANDSTILL, Twist
from visual_servo_epipolar.core.laws.braking import braked_turn
from visual_servo_epipolar.core.laws.machine import PhaseRow
from visual_servo_epipolar.core.laws.phase import Event, Phase
from visual_servo_epipolar.core.laws.phases.arrival import stopping
from visual_servo_epipolar.core.laws.phases.bounds import engage_bound
from visual_servo_epipolar.core.laws.phases.conditions import discordant_bearing, with_new_leg
from visual_servo_epipolar.core.laws.state import ServoState
from visual_servo_epipolar.core.laws.two_steps import equations
from visual_servo_epipolar.core.laws.two_steps.derived_gains import legal_target
from visual_servo_epipolar.core.perception.measurement import Measurement
from visual_servo_epipolar.core.reasons import Reason

MOST_RESTARTS = 12  # of step 1 in an attempt: it goes to and fro


def _classify(state: ServoState, measurement: Measurement, settings: DriveSettings) -> Event:
    if measurement.bearings is None:
        return Event.LOST
    alpha = measurement.bearings.alpha
    if abs(measurement.bearings.chi) <= engage_bound(measurement, settings):
        return Event.DISPLACED  # e_du is zero already: any e_au will do
    if not settings.options.discordant_turn and not settings.derives:
        return Event.DISPLACED if abs(alpha) > settings.singular_epipole else Event.NOTHING
    off = alpha - math.atan(state.law.target)
    if settings.options.speed_ramps:  # also once it stands
        turn = stopping(state.twist.angular, settings.max_angular_acceleration, settings)
        off = max(off, off + turn, key=abs)
    return Event.DISPLACED if abs(off) <= settings.displacement_tolerance else Event.NOTHING


def _command(state: ServoState, measurement: Measurement, settings: DriveSettings) -> Twist:
    """Return the turn in place of e_au to its target (section IV-B, remarks)."""
    if measurement.bearings is None:
        return STANDSTILL
    bearings = measurement.bearings
    if settings.options.speed_ramps:
        angle = math.atan(state.law.target) - bearings.alpha
        return Twist(0.0, braked_turn(angle, state, settings))
    return equations.turn_epipole(
        bearings.epipole_current, state.law.target, k1=settings.turn_gain
    )


def _begin(state: ServoState, measurement: Measurement, settings: DriveSettings) -> ServoState:
    """
    Return ``state`` with a new leg, and the target of e_au.

    ValueError if none is legal, or step 1 was given up too often in this attempt.
    """
    if state.run.restarts >= MOST_RESTARTS and settings.options.speed_ramps:
        raise ValueError(Reason.RESTARTED.of(state.run.restarts))
    state = with_new_leg(state, measurement)
    if settings.derives:
        return state.changed(target=legal_target(state, measurement, settings))
    return state.changed(target=_target(measurement, settings))


def _target(measurement: Measurement, settings: DriveSettings) -> float:
    """Return the abscissa of e_au for DISPLACING (section IV-B, remarks; or discordant)."""
    bearings = measurement.bearings
    if bearings is None:
        return 0.0
    if not settings.options.discordant_turn:
        return math.copysign(math.tan(2.0 * settings.singular_epipole), bearings.epipole_current)
    return math.tan(discordant_bearing(measurement, settings))


DISPLACING = PhaseRow(
    phase=Phase.DISPLACING,
    words='turns, to begin step 1 with the goal on the right side',
    colour='#56B4E9',
    classify=_classify,
    command=_command,
    begin=_begin,
)
