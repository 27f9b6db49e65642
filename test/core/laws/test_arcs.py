"""Arcs: which motions end at the goal, and the way back to one that does."""

import math

from hypothesis import given
import numpy as np
import pytest
from strategies import floats

from visual_servo_epipolar.core.laws.on_arcs import Bounds, GoalOffset, misses, moved, way_back

BOUNDS = Bounds(1.667, 0.6, 0.6)


def at(x: float, y: float, heading: float) -> GoalOffset:
    return GoalOffset(*(np.array([value]) for value in (x, y, heading)))


def missed(x: float, y: float, heading: float, bounds: Bounds = BOUNDS) -> float:
    return float(misses(at(x, y, heading), heading, bounds)[0])


def test_a_motion_along_the_axis_ends_at_the_goal_and_an_offset_needs_its_way() -> None:
    assert missed(0.0, -2.0, 0.0) < 1e-6
    # Two arcs of radius r move aside by x over a way of sqrt(4 r x - x^2) at least.
    least = math.sqrt(4.0 * 0.3 / 1.667 - 0.3**2)
    assert missed(0.3, -0.6 * least, 0.0) > 100.0
    assert missed(0.3, -2.5 * least, 0.0) < 1.0


def test_what_a_narrow_view_does_not_allow_is_no_way() -> None:
    assert missed(1.0, -2.5, 0.0) < 1.0
    assert missed(1.0, -2.5, 0.0, Bounds(1.667, 0.2, 0.2)) > 1.0


@given(floats(-1.5, 1.5), floats(-4.0, -0.2), floats(-0.3, 0.3))
def test_the_mirrored_motion_misses_as_much(x: float, y: float, heading: float) -> None:
    assert missed(x, y, heading) == pytest.approx(missed(-x, y, -heading), rel=1e-6, abs=1e-6)


@given(floats(-1.2, 1.2), floats(-1.5, 0.5), floats(-0.25, 0.25))
def test_after_the_way_back_one_motion_ends_at_the_goal(x, y, heading) -> None:
    assert way_back((0.2, -2.0, 0.0), 0.0, BOUNDS).way == 0.0  # where there is no need
    backing = way_back((x, y, heading), 0.0, BOUNDS)
    assert abs(backing.curvature) <= BOUNDS.curvature
    there = moved(at(x, y, heading), np.array([-backing.way]), np.array([backing.curvature]))
    assert float(misses(there, heading, BOUNDS)[0]) <= 1.0
