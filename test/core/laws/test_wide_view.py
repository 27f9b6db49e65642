"""Wide views: around the goal by a window of headings, and what is left of the distance."""

from dataclasses import replace
import math

import numpy as np
import pytest
from servo_states import asked, sight

from visual_servo_epipolar.core.laws.smooth import approach, back_off
from visual_servo_epipolar.core.laws.steering import (
    aim,
    goes_around_in_view,
    leads_around,
    polar_pose,
    share_left,
    visible_aim,
)
from visual_servo_epipolar.core.servo.run_log import summarise
from visual_servo_epipolar.core.servo.settings import ServoSettings
from visual_servo_epipolar.core.servo.state import ServoState
from visual_servo_epipolar.core.twoview.measurement import Measurement
from visual_servo_epipolar.simulation.scenario import from_document
from visual_servo_epipolar.simulation.views import drive

STEP = 1e-3
PINHOLE, HEAD = (0.35, 0.35), (2.2, 2.2)  # margins of a view that faces the goal [rad]
FREE = ServoSettings(law='smooth')
CAR = replace(FREE, base='car', max_curvature=1.667)
ON_A_HEAD = from_document(
    {'camera': {'rig': 'pan_tilt'}, 'servo': {'rig': 'pan_tilt', 'law': 'smooth'}}, 'test'
)


def seen(margins: tuple[float, float]) -> Measurement:
    return sight(heading_error=0.0, view_margins=margins)


def driven_straight(phi: float, heading: float) -> float:
    """Return the distance at which a straight line from a metre away meets the aim of delta."""
    x, y = -math.sin(phi), -math.cos(phi)
    for _ in range(4000):
        pose = polar_pose(x, y, heading)
        if pose.delta < aim(pose.phi):
            return pose.distance
        x, y = x - STEP * math.sin(heading), y + STEP * math.cos(heading)
    return math.nan


@pytest.mark.parametrize(('degrees', 'edge'), [(70.0, 100.0), (90.0, 115.0), (60.0, 95.0)])
def test_what_is_left_of_the_distance_is_that_of_a_straight_line(degrees, edge) -> None:
    phi, edge = math.radians(degrees), math.radians(edge)
    share = share_left(phi, (-edge, edge))
    assert share == pytest.approx(driven_straight(phi, -edge), abs=5e-3)
    assert share == share_left(-phi, (-edge, edge))


def test_a_head_leads_around_from_beside_and_not_from_ahead_of_the_goal() -> None:
    beside, ahead = polar_pose(-2.0, 0.0, 0.0), polar_pose(-0.5, 2.0, 0.0)
    assert leads_around(beside, seen(HEAD), FREE) and not leads_around(ahead, seen(HEAD), FREE)
    assert not leads_around(beside, seen(PINHOLE), FREE)


def test_at_the_goal_and_behind_it_the_line_is_followed() -> None:
    assert goes_around_in_view(polar_pose(-2.0, 0.0, 0.0), seen(HEAD), FREE)
    assert not goes_around_in_view(polar_pose(-0.2, 0.0, 0.0), seen(HEAD), FREE)
    assert not goes_around_in_view(polar_pose(-0.2, -3.0, 0.0), seen(HEAD), FREE)


@pytest.mark.parametrize('margins', [PINHOLE, HEAD])
@pytest.mark.parametrize('heading', [0.0, 1.3, -2.0])
def test_a_car_far_off_its_heading_drives_on_in_any_view(margins, heading: float) -> None:
    beside = sight(offset=(-2.0, -0.5), heading_error=heading, view_margins=margins)
    assert not leads_around(polar_pose(-2.0, -0.5, heading), beside, CAR)
    assert abs(asked(approach, ServoState(), beside, CAR).linear) > 0.05
    assert asked(back_off, ServoState(), beside, CAR).linear == -CAR.retreat_speed


@pytest.mark.parametrize('aside', [-0.05, 0.0, 0.05])
def test_behind_its_goal_a_wide_view_backs_off_straight(aside: float) -> None:
    """Around the goal there is no way from here, to either side: it would turn to and fro."""
    behind = sight(offset=(aside, -0.6), heading_error=0.0, view_margins=HEAD)
    twist = asked(back_off, ServoState(), behind, FREE)
    assert twist.linear < -0.1 and abs(twist.angular) < 0.05


@pytest.mark.parametrize(('x', 'y'), [(1.2, 1.6), (-2.0, 2.2)])
def test_ahead_of_its_goal_a_wide_view_backs_off_on_one_arc(x: float, y: float) -> None:
    """Where one way to back off gives over to the next, it must not turn to and fro."""
    heading, turns = 0.0, []
    while y > 0.2 and len(turns) < 400:
        margins = 2.2 - heading, 2.2 + heading
        here = sight(offset=(x, y), heading_error=heading, view_margins=margins)
        twist = asked(back_off, ServoState(), here, FREE)
        x -= 0.1 * twist.linear * math.sin(heading)
        y += 0.1 * twist.linear * math.cos(heading)
        heading += 0.1 * twist.angular
        turns.append(twist.angular)
    assert y <= 0.2 and abs(x) < 0.1
    assert np.count_nonzero(np.diff(np.sign(turns))) <= 1


def test_a_turn_goes_the_long_way_where_the_short_one_leads_out_of_view() -> None:
    margins = 0.2, 4.2  # turned left as far as it sees
    held = visible_aim(-2.0, 1.5, margins)
    assert held == -2.0  # 3.5 rad to the right, not 2.8 to the left
    assert visible_aim(1.0, 1.5, margins) is None
    assert visible_aim(2.5, 1.5, (0.2, 0.3)) == pytest.approx(1.7)


@pytest.mark.parametrize('side', [1.0, -1.0])
def test_the_base_waits_for_a_head_that_lags(side: float) -> None:
    settings = ServoSettings(law='smooth', rig='pan_tilt', pan_speed=0.1)
    ahead = sight(offset=(side * 2.0, -1.0), heading_error=0.0, view_margins=HEAD)
    free = asked(approach, ServoState(), ahead, settings)
    assert side * free.angular > 0.3
    lagging = replace(ahead, present_margins=(0.05, 0.05))
    held = asked(approach, ServoState(), lagging, settings)
    assert side * held.angular == pytest.approx(settings.pan_speed)


def test_turned_away_it_turns_back_the_way_that_shows_the_goal() -> None:
    settings = ServoSettings(law='smooth', rig='pan_tilt')
    away = sight(offset=(-2.0, -0.5), heading_error=-3.07, view_margins=(0.02, 4.2))
    assert asked(approach, ServoState(), away, settings).angular < -0.3


@pytest.mark.parametrize(
    ('start', 'camera', 'most'),
    [
        ((-2.0, 0.1, 5.0), {}, {'max_distance_ratio': 1.05, 'path_length_m': 4.0}),
        ((0.4, 2.0, 80.0), {}, {'max_distance_ratio': 1.05, 'path_length_m': 4.08}),
        ((0.3, -1.0, 20.0), {'head_encoder_noise': 4e-3}, {'duration_s': 15.0}),
        ((-2.0, 0.1, 5.0), {'tilt': math.radians(5.0)}, {}),
    ],
    ids=['beside', 'ahead', 'noisy encoder', 'leans by what is not configured'],
)
def test_with_a_head_no_robot_goes_away_from_its_goal(start, camera, most) -> None:
    scenario = replace(ON_A_HEAD, camera=replace(ON_A_HEAD.camera, **camera))
    result = summarise(drive(scenario, start, 3))
    assert result['outcome'] == 'arrived', result['reason']
    assert result['position_error_m'] < 0.003 and abs(result['heading_error_deg']) < 0.3
    assert all(result[name] < bound for name, bound in most.items())
