"""Lines to the goal: where step 2 alone leads home, as a memory of views has the offset."""

import math

from visual_servo_epipolar.core.estimate.settings import DriveSettings
from visual_servo_epipolar.core.laws.state import ServoState
from visual_servo_epipolar.core.laws.two_steps import equations
from visual_servo_epipolar.core.odometry.ranging import (
    LEAST_LOOK_AHEAD,
    LEAST_REMEMBERED,
    look_ahead,
    LOOK_AHEADS,
    UNKNOWN_RANGE,
)
from visual_servo_epipolar.core.perception.measurement import Measurement

RESIDUAL_OFFSET = 5e-4  # that line following may leave [m]
LAST_SHARE, LAST_LOOK_AHEAD = 0.5, 0.03  # of the way that is left, and at least [m]
LAST_TURN = 0.05  # that it may take [rad]
MOST_ASIDE = 0.5  # offset in look-aheads: more would turn features out of view
MOST_TURNED = 0.35  # heading error to begin with [rad]


def line_look_ahead(state: ServoState, measurement: Measurement, settings: DriveSettings) -> float:
    """
    Return the look-ahead of line following [m]: shorter where the offset is known.

    What only the last decimetres show of that is undone there, within half of the way that is
    left; the turn that it takes is small, and undone at the goal.
    """
    if measurement.offset is None:
        return look_ahead(state.motion.range, settings.look_ahead)
    x, y = measurement.offset
    gentle = max(abs(x), measurement.offset_deviation) / LAST_TURN
    least = min(max(-LAST_SHARE * y, LAST_LOOK_AHEAD, gentle), LEAST_REMEMBERED)
    return _remembered_look_ahead(y, settings, least)


def _remembered_look_ahead(
    y: float, settings: DriveSettings, least: float = LEAST_REMEMBERED
) -> float:
    """Return the look-ahead [m] where a memory of views has the robot ``y`` ahead of the goal."""
    return look_ahead(max(-y, LEAST_REMEMBERED), settings.look_ahead, least=least)


def offset_ratio(distance: float, measurement: Measurement, settings: DriveSettings) -> float:
    """
    Return the part of an offset that line following leaves over a ``distance`` to the goal [m].

    It falls by exp(-0.9 ds / L) over ds, and the look-ahead L shrinks with the way that is left: a
    quarter of that, between its bounds.
    """
    least = LEAST_LOOK_AHEAD if measurement.offset is None else LEAST_REMEMBERED
    least = min(least, settings.look_ahead)
    near, far = LOOK_AHEADS * least, LOOK_AHEADS * settings.look_ahead
    lengths = min(distance, near) / least + max(distance - far, 0.0) / settings.look_ahead
    lengths += LOOK_AHEADS * math.log(max(min(distance, far), near) / near)
    return math.exp(-equations.LINE_DAMPING * lengths)


def leads_home(measurement: Measurement, settings: DriveSettings) -> bool:
    """Return whether line following from here ends on the goal, as far as the offset is known."""
    if measurement.offset is None or not settings.options.line_following:
        return False
    x, y = measurement.offset
    length, turned = _remembered_look_ahead(y, settings), measurement.heading_error
    if y > -length or abs(turned) > MOST_TURNED or abs(x) > MOST_ASIDE * length:
        return False
    aside = abs(x) + length * math.tan(abs(turned))
    return aside * math.exp(equations.LINE_DAMPING * y / length) <= RESIDUAL_OFFSET


def lateral_offset(state: ServoState, measurement: Measurement) -> float:
    """Return the lateral offset x = d cos(psi) [m], right positive; 0 without bearings."""
    if measurement.offset is not None:
        return measurement.offset[0]
    if measurement.bearings is None:
        return 0.0
    distance = (
        min(state.motion.distance, UNKNOWN_RANGE)
        if math.isnan(state.motion.range)
        else state.motion.range
    )
    return distance * math.cos(measurement.bearings.psi)
