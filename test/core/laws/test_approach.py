"""Commands of one motion: within the view, braked to the goal, on in spite of doubt."""

from dataclasses import replace
import math

import numpy as np
import pytest
from servo_states import asked, behind, estimated, sight

from visual_servo_epipolar.core.estimate.map_state import first_pose, MapState
from visual_servo_epipolar.core.geometry.motion import Twist
from visual_servo_epipolar.core.goal import Goal
from visual_servo_epipolar.core.laws.smooth import approach, back_off
from visual_servo_epipolar.core.odometry.increments import Motion
from visual_servo_epipolar.core.servo.settings import ServoSettings
from visual_servo_epipolar.core.servo.state import ServoState
from visual_servo_epipolar.core.twoview.measurement import Measurement

SETTINGS = ServoSettings(law='smooth')
STATE = ServoState()
WIDE = (1.0, 1.0)


def known(x: float, y: float, heading: float = 0.0, **changes: object) -> Measurement:
    """Return what is seen from x, y [m] and a heading error [rad] by who remembers views."""
    return sight(
        offset=(x, y), offset_deviation=1e-3, heading_error=heading, view_margins=WIDE, **changes
    )


def command(measurement: Measurement) -> Twist:
    return asked(approach, STATE, measurement, SETTINGS)


@pytest.mark.parametrize('side', [1.0, -1.0])
def test_it_turns_to_its_aim_but_never_out_of_view(side: float) -> None:
    aside = known(side * 1.0, -3.0)
    assert side * command(aside).angular > 0.1
    left, right = (0.0, 1.0) if side > 0.0 else (1.0, 0.0)
    assert side * command(replace(aside, view_margins=(left, right))).angular <= 0.0


@pytest.mark.parametrize('way', [1.0, 0.3, 0.1, 0.03, 0.01, 0.001])
def test_it_can_always_stop_at_the_goal(way: float) -> None:
    speed = command(known(0.0, -way)).linear
    assert 0.0 < speed <= math.sqrt(2.0 * 2.0 * SETTINGS.max_acceleration * way)


def test_past_the_goal_it_comes_back_and_without_bearings_or_memory_it_stands() -> None:
    assert command(known(0.0, 0.01)).linear < 0.0
    assert command(sight(bearings=None)) == Twist(0.0, 0.0)


@pytest.mark.parametrize(
    ('usual', 'slower', 'least'),
    [
        (known(0.0, -0.15), known(0.03, -0.15), 0.02),  # much is aside
        (known(0.0, -3.0), known(0.0, -3.0, deviation=0.09), 0.05),  # bearings are uncertain
    ],
)
def test_it_goes_slower_in_doubt_but_does_not_stand(usual, slower, least: float) -> None:
    assert least < command(slower).linear < command(usual).linear


def test_at_the_goal_it_turns_to_its_heading_alone() -> None:
    twist = command(known(0.0, -0.0005, 0.01))
    assert twist.angular == pytest.approx(-0.04, rel=0.2)


def test_a_camera_that_looks_aside_leads_along_the_axis_of_the_base() -> None:
    yaw, way = 0.0175, 0.2
    place = replace(first_pose(np.zeros(3), np.eye(3), Motion()), mean=np.array([0, 0, 0, yaw]))
    state = estimated(STATE.changed(goal=Goal(map=MapState(place=place))))
    on_axis = known(-yaw * way, -way)
    assert asked(approach, state, on_axis, SETTINGS).angular == pytest.approx(0.0, abs=1e-4)
    assert abs(asked(approach, STATE, on_axis, SETTINGS).angular) > 0.01


def unsure_of(deviation: float) -> ServoState:
    """Return the state of a robot whose averaged place is unknown by a ``deviation`` [m]."""
    place = first_pose(np.zeros(3), deviation**2 * np.eye(3), Motion())
    return estimated(STATE.changed(goal=Goal(map=MapState(place=place))))


def test_what_may_be_no_offset_is_no_reason_to_turn() -> None:
    aside = known(0.003, -0.04)
    sure, unsure = (asked(approach, unsure_of(each), aside, SETTINGS) for each in (3e-4, 5e-3))
    assert 0.0 < unsure.angular < 0.5 * sure.angular


def test_a_robot_that_may_not_back_off_comes_in_at_a_speed_that_shows_what_is_aside() -> None:
    final, on_axis = replace(SETTINGS, max_retreat=0.0), known(0.0, -0.3)
    usual = asked(approach, STATE, on_axis, SETTINGS)
    assert asked(approach, unsure_of(3e-4), on_axis, final) == usual
    assert 0.02 < asked(approach, unsure_of(2.5e-3), on_axis, final).linear < 0.2 * usual.linear


def test_backing_off_leads_towards_the_axis_within_the_view() -> None:
    beside = sight(bearings=behind(-1.2, 0.0), heading_error=0.0, view_margins=WIDE)
    free = asked(back_off, STATE, beside, SETTINGS)
    assert free.linear < 0.0
    assert -free.linear <= SETTINGS.retreat_speed
    hidden = replace(beside, view_margins=(0.0, 0.0))
    assert asked(back_off, STATE, hidden, SETTINGS).angular == pytest.approx(0.0, abs=1e-9)
