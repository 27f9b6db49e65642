"""Conditions on a measurement that phases share: where the goal lies, what can be trusted."""

import math

from visual_servo_epipolar.core.estimate.settings import DriveSettings
from visual_servo_epipolar.core.geometry.epipolar import Bearings
from visual_servo_epipolar.core.laws.phase import Event
from visual_servo_epipolar.core.laws.phases.bounds import engage_bound
from visual_servo_epipolar.core.laws.state import ServoState
from visual_servo_epipolar.core.laws.two_steps import equations
from visual_servo_epipolar.core.odometry.ranging import Leg
from visual_servo_epipolar.core.perception.measurement import Measurement

TURNED = 1.0  # more than a robot turns between two images, or while it stands [rad]
ROOM = 0.18  # behind a goal whose place is known, to begin step 1 [m]
KNOWN = 0.009  # deviation of its bearing from there [rad]
LEAST_RATIO = 1e-9  # part of the distance that a law without retreat keeps


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
    """Return whether there is room for step 1; who remembers where the goal is needs less."""
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
    if measurement.bearings is not None:  # who faces far away sees no feature that D counts
        return False
    is_far = measurement.parallax > settings.near_parallax
    return is_far or not math.isfinite(measurement.difference)


def has_turned(state: ServoState, measurement: Measurement) -> bool:
    """Return whether the heading is not that of the last trusted image, by far."""
    turn = math.remainder(measurement.heading_error - state.view.trusted_heading, 2.0 * math.pi)
    return abs(turn) > TURNED


def begun_step_1(measurement: Measurement, settings: DriveSettings, event: Event) -> Event:
    """Return the ``event`` that begins step 1; where there is no room the robot backs off."""
    room = is_far_enough(measurement, settings) and not is_sideways(measurement, settings)
    return event if room or not settings.options.retreat else Event.SIDEWAYS


def with_new_leg(state: ServoState, measurement: Measurement) -> ServoState:
    """Return ``state`` where step 1 begins: the side of e_du, not at zero yet, and a new leg."""
    if measurement.bearings is None:
        return state
    side = math.copysign(1.0, measurement.bearings.chi)
    return state.changed(side=side, latched=False, leg=Leg(measurement.bearings.psi))
