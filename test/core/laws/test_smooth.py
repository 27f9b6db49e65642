"""One motion: its commands and phases, around the goal in wide views and with a head."""

from dataclasses import replace
import math
from typing import Any

from hypothesis import given
from hypothesis import strategies as st
import numpy as np
import pytest
from servo_states import asked, behind, estimated, in_phase, seeing, sight
from strategies import floats

from visual_servo_epipolar.core.estimate.map_state import first_pose, MapState
from visual_servo_epipolar.core.geometry.motion import Twist, wrap_angle
from visual_servo_epipolar.core.goal import Goal
from visual_servo_epipolar.core.laws.phase import Event, Phase
from visual_servo_epipolar.core.laws.smooth import approach, APPROACHING, back_off, ONE_MOTION
from visual_servo_epipolar.core.laws.steering import (
    goes_around,
    goes_around_in_view,
    leads_around,
    polar_pose,
    visible_aim,
)
from visual_servo_epipolar.core.odometry.increments import Motion
from visual_servo_epipolar.core.servo.run_log import summarise
from visual_servo_epipolar.core.servo.settings import ServoSettings
from visual_servo_epipolar.core.servo.settling import is_settled
from visual_servo_epipolar.core.servo.state import ServoState
from visual_servo_epipolar.core.servo.supervisor import classify
from visual_servo_epipolar.core.twoview.measurement import Measurement
from visual_servo_epipolar.simulation.scenario import from_document
from visual_servo_epipolar.simulation.views import drive

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


ASIDE = {'offset': (1.5, -0.6), 'offset_deviation': 0.01, 'view_margins': (1.0, 1.0)}


def event(measurement: Measurement, settled: int = 0, **changes: Any) -> Event:
    """Return the event of a measurement on the way."""
    state = seeing(in_phase(APPROACHING.phase), measurement=measurement, settled=settled)
    return classify(state, replace(SETTINGS, **changes))


@pytest.mark.parametrize(
    ('seen', 'expected'),
    [
        # Aside of the axis D may be zero far from the goal: step 2 would drive past it.
        ({'bearings': behind(0.05, 0.05), 'difference': 0.01}, Event.ALIGNED),
        ({'bearings': behind(0.55, -0.2), 'difference': 0.01}, Event.NOTHING),
        ({'offset': (0.5, -3.0), 'offset_deviation': 0.1}, Event.NOTHING),
        ({'bearings': behind(1.2, 0.3), **ASIDE}, Event.SIDEWAYS),
        ({'offset': (0.0, 0.08), 'offset_deviation': 1e-3}, Event.MISSED),
        ({'offset': (0.08, -0.02), 'offset_deviation': 1e-3}, Event.MISSED),
        ({'bearings': None}, Event.LOST),
    ],
    ids=['on the axis', 'aside', 'on the way', 'beside', 'past', 'beside at the end', 'blind'],
)
def test_what_is_seen_on_the_way_decides_how_it_goes_on(seen: dict, expected: Event) -> None:
    assert event(sight(**seen)) is expected


def test_it_ends_where_the_way_ends_though_aside_d_is_not_zero_there() -> None:
    aside = sight(
        offset=(0.027, 0.0),
        offset_deviation=1e-3,
        heading_error=0.0,
        difference=4.6e-4,
        difference_deviation=1e-5,
        difference_slope=0.3,
    )
    state = seeing(in_phase(APPROACHING.phase), measurement=aside)
    assert is_settled(state, SETTINGS)
    assert event(aside, settled=SETTINGS.arrival_frames) is Event.MISSED


@pytest.mark.parametrize('chi, begun', [(0.62, Event.APART), (0.7, Event.SIDEWAYS)])
def test_it_begins_as_far_aside_as_the_least_way_does(chi: float, begun: Event) -> None:
    start = sight(bearings=behind(chi, -0.3), heading_error=chi + 0.3, view_margins=(0.5, 0.1))
    state = seeing(in_phase(Phase.WAITING), measurement=start)
    assert classify(state, SETTINGS) is begun


def test_without_retreat_the_robot_never_backs_off() -> None:
    aside = sight(bearings=behind(1.2, 0.3), offset=(1.5, -0.6), offset_deviation=0.01)
    passed = sight(offset=(0.0, 0.08), offset_deviation=1e-3)
    assert event(aside, retreat=False) is Event.NOTHING
    assert event(passed, retreat=False) is Event.EXHAUSTED


def test_on_the_last_way_each_settled_frame_asks_for_less() -> None:
    near = sight(
        offset=(0.0, -3.3e-4),
        offset_deviation=1e-3,
        heading_error=0.0,
        difference=-1e-4,
        difference_deviation=1e-4,
        difference_slope=0.3,
    )
    first = seeing(in_phase(APPROACHING.phase), measurement=near)
    assert is_settled(first, SETTINGS)
    assert not is_settled(first.changed(settled=SETTINGS.arrival_frames - 1), SETTINGS)


def test_it_stands_nowhere_but_where_every_law_does() -> None:
    standing = {phase for phase in ONE_MOTION.rows if not phase.drives}
    assert standing == {Phase.WAITING, Phase.HOLDING, Phase.ARRIVED, Phase.FAILED}


ENDLESS = (math.inf, math.inf)
PERIOD_S = 0.1
angles = floats(-math.pi, math.pi)


def seen(x: float, y: float, heading: float) -> Measurement:
    """Return what a memory of views knows at x, y [m] and a heading error, all around in view."""
    return sight(offset=(x, y), offset_deviation=1e-3, heading_error=heading, view_margins=ENDLESS)


@given(floats(0.6, 4.0), angles, angles)
def test_from_every_pose_it_comes_near_the_goal(distance, direction, heading) -> None:
    x, y = distance * math.cos(direction), distance * math.sin(direction)
    way = 0.0
    for _ in range(1000):
        if not goes_around(x, y, heading, seen(x, y, heading)):
            break
        twist = asked(approach, ServoState(), seen(x, y, heading), SETTINGS)
        turn = float(np.clip(twist.angular, -SETTINGS.max_angular, SETTINGS.max_angular))
        heading = wrap_angle(heading + PERIOD_S * turn)
        x -= PERIOD_S * twist.linear * math.sin(heading)
        y += PERIOD_S * twist.linear * math.cos(heading)
        way += PERIOD_S * abs(twist.linear)
        assert math.hypot(x, y) <= 1.01 * distance
    assert y < 0.0 and abs(heading) < 0.8
    assert way < 3.0 * distance


@given(st.sampled_from([-1.0, 1.0]), floats(0.5, 4.0))
def test_beside_and_ahead_of_the_goal_nobody_backs_off_who_sees_all_around(side, distance) -> None:
    beside = behind(side * 1.4, side * 0.3)
    state = in_phase(APPROACHING.phase)
    for x, y in ((side * distance, 0.0), (0.1, distance)):
        known = {'bearings': beside, 'offset': (x, y), 'offset_deviation': 0.01}
        events = [
            classify(seeing(state, measurement=sight(view_margins=margins, **known)), SETTINGS)
            for margins in (ENDLESS, (1.0, 1.0))
        ]
        assert events[0] is Event.NOTHING
        assert events[1] in (Event.SIDEWAYS, Event.MISSED)


def test_near_the_goal_and_facing_it_the_line_is_followed() -> None:
    assert not goes_around(0.1, -0.3, 0.2, seen(0.1, -0.3, 0.2))
    assert goes_around(0.1, -0.3, 2.0, seen(0.1, -0.3, 2.0))
    assert not goes_around(1.0, 1.0, 0.0, sight(view_margins=(1.0, 1.0)))


PINHOLE, HEAD = (0.35, 0.35), (2.2, 2.2)  # margins of a view that faces the goal [rad]
CAR = replace(SETTINGS, base='car', max_curvature=1.667)
ON_A_HEAD = from_document(
    {'camera': {'rig': 'pan_tilt'}, 'servo': {'rig': 'pan_tilt', 'law': 'smooth'}}, 'test'
)


def facing(margins: tuple[float, float]) -> Measurement:
    return sight(heading_error=0.0, view_margins=margins)


def test_a_head_leads_around_from_beside_and_not_from_ahead_of_the_goal() -> None:
    beside, ahead = polar_pose(-2.0, 0.0, 0.0), polar_pose(-0.5, 2.0, 0.0)
    assert leads_around(beside, facing(HEAD), SETTINGS) and not leads_around(
        ahead, facing(HEAD), SETTINGS
    )
    assert not leads_around(beside, facing(PINHOLE), SETTINGS)


def test_at_the_goal_and_behind_it_the_line_is_followed() -> None:
    assert goes_around_in_view(polar_pose(-2.0, 0.0, 0.0), facing(HEAD), SETTINGS)
    assert not goes_around_in_view(polar_pose(-0.2, 0.0, 0.0), facing(HEAD), SETTINGS)
    assert not goes_around_in_view(polar_pose(-0.2, -3.0, 0.0), facing(HEAD), SETTINGS)


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
    twist = asked(back_off, ServoState(), behind, SETTINGS)
    assert twist.linear < -0.1 and abs(twist.angular) < 0.05


@pytest.mark.parametrize(('x', 'y'), [(1.2, 1.6), (-2.0, 2.2)])
def test_ahead_of_its_goal_a_wide_view_backs_off_on_one_arc(x: float, y: float) -> None:
    """Where one way to back off gives over to the next, it must not turn to and fro."""
    heading, turns = 0.0, []
    while y > 0.2 and len(turns) < 400:
        margins = 2.2 - heading, 2.2 + heading
        here = sight(offset=(x, y), heading_error=heading, view_margins=margins)
        twist = asked(back_off, ServoState(), here, SETTINGS)
        x -= 0.1 * twist.linear * math.sin(heading)
        y += 0.1 * twist.linear * math.cos(heading)
        heading += 0.1 * twist.angular
        turns.append(twist.angular)
    assert y <= 0.2 and abs(x) < 0.1
    assert np.count_nonzero(np.diff(np.sign(turns))) <= 1


def test_a_turn_goes_the_long_way_where_the_short_one_leads_out_of_view() -> None:
    margins = 0.2, 4.2  # turned left as far as it sees
    assert visible_aim(-2.0, 1.5, margins) == -2.0  # 3.5 rad to the right, not 2.8 to the left
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
