"""Retreating: the robot backs off at the heading of the goal, to come in from behind."""

from visual_servo_epipolar.core.estimate.settings import DriveSettings
from visual_servo_epipolar.core.geometry.motion import STANDSTILL, Twist
from visual_servo_epipolar.core.laws.braking import settled_turn
from visual_servo_epipolar.core.laws.machine import PhaseRow
from visual_servo_epipolar.core.laws.phase import Event, Phase
from visual_servo_epipolar.core.laws.phases.conditions import (
    is_far_enough,
    is_sideways,
    is_untrusted,
    leads_home,
)
from visual_servo_epipolar.core.laws.state import ServoState
from visual_servo_epipolar.core.perception.measurement import Measurement


def _classify(state: ServoState, measurement: Measurement, settings: DriveSettings) -> Event:
    if is_untrusted(measurement, settings):
        return Event.LOST
    if not has_run_up(state, measurement, settings):
        return Event.NOTHING
    if leads_home(measurement, settings):
        return Event.ALIGNED
    if measurement.bearings is None or not is_far_enough(measurement, settings):
        return Event.NOTHING
    within = abs(measurement.bearings.chi) <= settings.retreat_bearing
    return Event.APART if within and not is_sideways(measurement, settings) else Event.NOTHING


def has_run_up(state: ServoState, measurement: Measurement, settings: DriveSettings) -> bool:
    """
    Return whether a retreat after a miss has led as far as that asks for.

    Who missed twice knows less of where the goal is than it believes: before a wall, straight
    back, a short way tells hardly what is aside.
    """
    misses = state.run.attempts - 1
    return misses < 2 or measurement.difference <= -misses * settings.retreat_difference


def _command(state: ServoState, measurement: Measurement, settings: DriveSettings) -> Twist:
    """Return the turn to the goal's heading as far as the view allows, then with backing off."""
    if settings.max_retreat == 0.0:
        return STANDSTILL
    left, right = measurement.view_margins
    angle = min(max(-measurement.heading_error, -right), left)
    turning = abs(angle) > settings.retreat_heading
    return Twist(0.0 if turning else -settings.retreat_speed, settled_turn(angle, state, settings))


RETREATING = PhaseRow(
    phase=Phase.RETREATING,
    words='backs off, to come in from behind',
    colour='#E69F00',
    classify=_classify,
    command=_command,
    begin=lambda state, *_: state.changed(leg=None),  # which ranges the goal in step 1
)
