"""Lines: those that lead home, where step 2 alone ends on the goal, and how they are followed."""

from dataclasses import replace
import math

import pytest
from servo_states import goal, in_phase, SETTINGS, sight

from visual_servo_epipolar.core.estimate.base_model import Curvature
from visual_servo_epipolar.core.geometry.motion import integrate, Pose, Twist
from visual_servo_epipolar.core.laws.conditions import (
    KNOWN,
    LAST_LOOK_AHEAD,
    leads_home,
    line_look_ahead,
    ROOM,
)
from visual_servo_epipolar.core.laws.equations import follow_line
from visual_servo_epipolar.core.laws.phase import Event, Phase
from visual_servo_epipolar.core.odometry.legs import LEAST_LOOK_AHEAD, LEAST_REMEMBERED
from visual_servo_epipolar.core.servo.settings import ServoSettings
from visual_servo_epipolar.core.servo.state import ServoState
from visual_servo_epipolar.core.servo.supervisor import classify, compensate_curvature
from visual_servo_epipolar.core.twoview.measurement import Measurement

STATE = in_phase(Phase.RETREATING)


def at(x: float, y: float, degrees: float = 0.0) -> Measurement:
    """Return what is seen from x, y [m] by who remembers views."""
    return sight(
        offset=(x, y),
        offset_deviation=1e-3,
        heading_deviation=1e-4,
        difference_slope=0.1,
        difference=0.1 * y,
        heading_error=math.radians(degrees),
    )


def end_of_line(measurement: Measurement) -> float:
    """Return how far aside a robot passes the goal that follows the line [m]."""
    x, y = measurement.offset
    heading = measurement.heading_error
    while y < 0.0:
        seen = replace(measurement, offset=(x, y))
        length = line_look_ahead(goal(seen, STATE), SETTINGS)
        heading += follow_line(1.0, x, heading, look_ahead=length).angular * 1e-4
        x, y = x - 1e-4 * math.sin(heading), y + 1e-4 * math.cos(heading)
    return x


@pytest.mark.parametrize(
    ('start', 'leads'),
    [
        ((0.003, -0.4, 2.0), True),
        ((-0.01, -0.45, 0.0), True),
        ((0.01, -0.6, -3.0), True),
        ((0.0, -0.5, 8.0), True),
        ((0.05, -0.25, 0.0), False),  # aside
        ((0.0, -0.25, 21.0), False),  # turned
        ((0.0, -0.05, 0.0), False),  # too near
        ((0.0, 0.2, 0.0), False),  # past the goal
        ((0.2, -1.0, 0.0), False),
    ],
)
def test_a_line_that_leads_home_does(start, leads: bool) -> None:
    measurement = at(*start)
    assert leads_home(measurement, SETTINGS) is leads
    assert not leads or abs(end_of_line(measurement)) < 1e-3
    # Without the offset it is unknown, and not every law follows it.
    assert not leads_home(replace(measurement, offset=None), SETTINGS)
    assert not leads_home(measurement, replace(SETTINGS, line_following=False))


@pytest.mark.parametrize(
    ('seen', 'length'),
    [
        (sight(), LEAST_LOOK_AHEAD),
        (at(0.0, -0.3), LEAST_REMEMBERED),
        (at(0.0, -0.1), 0.05),
        (at(0.0, -0.01), LAST_LOOK_AHEAD),
        (at(0.0, 0.05), LAST_LOOK_AHEAD),
        # No sharp turns for an offset that is large, or hardly known.
        (at(0.002, -0.01), 0.04),
        (at(0.01, -0.01), LEAST_REMEMBERED),
        (replace(at(0.0, -0.01), offset_deviation=0.003), 0.06),
        (at(0.0, -9.0), SETTINGS.look_ahead),
    ],
)
def test_the_look_ahead_is_shorter_where_the_offset_is_known(seen, length: float) -> None:
    near = in_phase(Phase.MATCHING_FEATURES, distance=0.1)
    assert line_look_ahead(goal(seen, near), SETTINGS) == pytest.approx(length)


def test_a_retreat_ends_where_a_line_leads_home_or_where_there_is_room() -> None:
    def event(measurement: Measurement) -> Event:
        return classify(in_phase(Phase.RETREATING, measurement=measurement), SETTINGS)

    assert event(at(0.001, -0.24)) is Event.ALIGNED
    assert event(at(0.05, 0.01 - ROOM)) is Event.NOTHING
    assert event(at(0.05, -ROOM)) is Event.APART
    # Before a wall its place is not known yet, though a number is told.
    assert event(replace(at(0.05, -ROOM), deviation=2.0 * KNOWN)) is Event.NOTHING
    # Two views alone have to see more of it.
    alone = replace(at(0.05, -ROOM), offset=None)
    assert event(alone) is Event.NOTHING
    assert event(replace(alone, difference=-SETTINGS.retreat_difference)) is Event.APART


def test_who_missed_twice_takes_a_longer_run_up() -> None:
    def event(measurement: Measurement, attempts: int) -> Event:
        state = in_phase(Phase.RETREATING, measurement=measurement, attempts=attempts)
        return classify(state, SETTINGS)

    unsure = replace(
        at(0.001, -0.5), deviation=2.0 * KNOWN, difference=-1.5 * SETTINGS.retreat_difference
    )
    assert [event(unsure, attempts) for attempts in (1, 2, 3)] == [
        Event.ALIGNED,
        Event.ALIGNED,
        Event.NOTHING,
    ]
    farther = replace(unsure, difference=-2.5 * SETTINGS.retreat_difference)
    assert event(farther, 3) is Event.ALIGNED
    assert event(farther, 4) is Event.NOTHING


def test_a_turn_that_a_base_cannot_make_is_not_wanted() -> None:
    """It follows the line by whole turns alone, and drives straight on until one is needed."""
    length, least, x, heading, turns = 0.25, math.radians(0.2), 0.004, 0.0, []
    for _ in range(4000):
        wanted = follow_line(1.0, x, heading, look_ahead=length, least_turn=least).angular
        if wanted:
            turns.append(wanted)
            heading += math.copysign(2.0 * least, wanted)
        x -= 1e-3 * math.sin(heading)
    assert 1 <= len(turns) <= 6
    assert abs(x) < 2.0 * length * least  # as near as headings within the least turn lead
    assert follow_line(1.0, 0.0, 0.9 * least, look_ahead=length, least_turn=least).angular == 0.0
    assert follow_line(1.0, 0.0, 1.1 * least, look_ahead=length, least_turn=least).angular < 0.0


def test_where_the_line_is_unknown_the_robot_does_not_drive_straight_on() -> None:
    for x, heading in ((math.nan, 0.0), (0.0, math.nan)):
        with pytest.raises(ValueError):
            follow_line(1.0, x, heading, look_ahead=0.25)


@pytest.mark.parametrize('speed', [0.4, -0.4])
def test_following_the_line_removes_offset_and_heading_at_either_sign_of_speed(speed) -> None:
    pose = Pose(0.05, -4.0 if speed > 0 else 0.0, math.pi / 2 - 0.03)
    for _ in range(900):
        twist = follow_line(speed, pose.x, pose.heading_error, look_ahead=0.5)
        pose = integrate(pose, twist, 0.01)
    # 3.6 m are 7 look-aheads: exp(-0.9 * 7) of 50 mm is 0.1 mm.
    assert abs(pose.x) < 2e-4
    assert abs(pose.heading_error) < 1e-3


def test_a_known_curvature_is_steered_against() -> None:
    state = ServoState().changed(curvature=Curvature(0.02))
    for law, turn in (('full', 0.092), ('paper', 0.1)):
        twist = compensate_curvature(Twist(0.4, 0.1), state, ServoSettings(law=law))
        assert (twist.linear, twist.angular) == pytest.approx((0.4, turn))
