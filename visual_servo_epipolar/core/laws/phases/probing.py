"""
Probing: a short way before a plane, where two geometries fit and only motion tells them apart.

The robot drives straight on, or back near the goal, in legs between which it turns a little, as a
leg along the baseline tells nothing. Once one geometry is left it stands, and surveys the goal.
"""

import math

from visual_servo_epipolar.core.bases.base import turns_in_place
from visual_servo_epipolar.core.estimate.settings import DriveSettings
from visual_servo_epipolar.core.geometry.motion import Twist
from visual_servo_epipolar.core.laws.braking import settled_turn
from visual_servo_epipolar.core.laws.phase import Event
from visual_servo_epipolar.core.laws.phases.conditions import is_far_enough
from visual_servo_epipolar.core.laws.state import DriveState
from visual_servo_epipolar.core.perception.measurement import Measurement
from visual_servo_epipolar.core.perception.rivals import Rivals

LEG, LEGS = 0.3, 3  # way [m]
SWING, SWUNG = 0.3, 0.03  # of the second leg to one side, the third to the other [rad]
MOST_PROBES = 3  # in an attempt


def begun_probe(state: DriveState, measurement: Measurement, settings: DriveSettings) -> Event:
    """Return the event that begins a probe where ``measurement`` has rivals: LOST if none may."""
    if not settings.remembers or state.run.restarts >= MOST_PROBES:
        return Event.LOST
    if _leads_ahead(measurement, settings):
        return Event.AMBIGUOUS
    return Event.AMBIGUOUS_NEAR if settings.max_retreat > 0.0 else Event.LOST


def is_probing(state: DriveState) -> bool:
    """Return whether the phase is a probe."""
    return state.phase.drives and state.run.event in (Event.AMBIGUOUS, Event.AMBIGUOUS_NEAR)


def classify_probe(state: DriveState, measurement: Measurement, settings: DriveSettings) -> Event:
    """Return the event of a probe: whether one geometry is left, or it ends without."""
    if measurement.bearings is not None or not measurement.rivals:
        return Event.LOST if measurement.bearings is None else Event.RESOLVED
    if state.phase.backs_off:
        spent = _way(state) > min(LEGS * LEG, 0.9 * settings.max_retreat)
    else:
        spent = _way(state) > LEGS * LEG or not _leads_ahead(measurement, settings)
    return Event.LOST if spent else Event.NOTHING


def probe(state: DriveState, measurement: Measurement, settings: DriveSettings) -> Twist:
    """Return the velocity of a probe: straight on, or the turn to the next leg."""
    angle = _turn_left(state, measurement)
    if turns_in_place(settings.drive) and abs(angle) > SWUNG:
        return Twist(0.0, settled_turn(angle, state, settings))
    return Twist(-settings.retreat_speed if state.phase.backs_off else settings.retreat_speed, 0.0)


def _rivals(state: DriveState) -> Rivals | None:
    return None if state.view.memory is None else state.view.memory.rivals


def _way(state: DriveState) -> float:
    rivals = _rivals(state)
    return 0.0 if rivals is None else rivals.way


def _turn_left(state: DriveState, measurement: Measurement) -> float:
    """Return the turn to the heading of the leg, as far as the view allows [rad]."""
    rivals = _rivals(state)
    if rivals is None:
        return 0.0
    swing = (0.0, SWING, -SWING)[min(int(rivals.way / LEG), LEGS - 1)]
    turned = math.remainder(measurement.rotation_heading - rivals.turn, 2.0 * math.pi)
    left, right = measurement.view_margins
    return min(max(swing - turned, -right), left)


def _leads_ahead(measurement: Measurement, settings: DriveSettings) -> bool:
    """Return whether the goal is ahead by both geometries, and not near."""
    ahead = max(abs(each.alpha) for each in measurement.rivals) <= settings.sideways_bearing
    return ahead and is_far_enough(measurement, settings)
