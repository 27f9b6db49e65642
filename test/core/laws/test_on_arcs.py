"""One motion of a car: which arcs end at the goal, bounded in curvature and in reversals."""

from dataclasses import replace
from itertools import pairwise
import math

from hypothesis import given
import numpy as np
import pytest
from servo_states import in_phase, seeing, sight
from strategies import floats

from visual_servo_epipolar.commands.arguments import rig_path
from visual_servo_epipolar.core.laws.on_arcs import (
    Bounds,
    GoalOffset,
    misses,
    moved,
    ON_ARCS,
    way_back,
)
from visual_servo_epipolar.core.laws.phase import Event, Phase
from visual_servo_epipolar.core.laws.smooth import APPROACHING, ONE_MOTION
from visual_servo_epipolar.core.servo.run_log import RunLog, summarise
from visual_servo_epipolar.core.servo.settings import ServoSettings
from visual_servo_epipolar.core.servo.supervisor import classify
from visual_servo_epipolar.simulation.scenario import load
from visual_servo_epipolar.simulation.views import drive

CAR = {'law': 'smooth', 'base': 'car', 'max_curvature': 1.667}
SETTINGS = ServoSettings(**CAR)
FREELY = ONE_MOTION.transitions


@pytest.fixture(scope='module')
def beside() -> RunLog:
    scenario = load(None, rig_path('car')).seeded(7)
    return drive(scenario, (0.5, -0.2, -8.0), 7)


def test_a_car_beside_its_goal_arrives(beside: RunLog) -> None:
    result = summarise(beside)
    assert result['outcome'] == 'arrived', result['reason']
    assert result['position_error_m'] < 3e-3
    assert abs(result['heading_error_deg']) < 0.1


def test_it_turns_no_more_than_it_can_and_reverses_as_often_as_it_says(beside: RunLog) -> None:
    twists = [sample.twist for sample in beside.samples]
    assert all(abs(twist.angular) <= abs(twist.linear) * 1.667 + 1e-12 for twist in twists)
    speeds = [twist.linear for twist in twists if twist.linear]
    assert 1 <= sum(before * after < 0.0 for before, after in pairwise(speeds)) <= 3


def event(attempts: int = 1, **known: object) -> Event:
    seen = sight(offset_deviation=1e-3, **known)
    state = seeing(in_phase(APPROACHING.phase), measurement=seen, attempts=attempts)
    return classify(state, SETTINGS)


def test_an_offset_that_no_curve_undoes_is_a_miss_at_once_in_bounded_attempts() -> None:
    assert event(offset=(0.05, -0.9), view_margins=(0.7, 0.7)) is Event.NOTHING
    near = {'offset': (0.15, -0.2), 'view_margins': (0.7, 0.7)}
    assert event(**near) is Event.MISSED
    assert event(SETTINGS.max_attempts, **near) is Event.EXHAUSTED


@pytest.mark.parametrize(
    ('attempts', 'tolerance', 'heading', 'expected'),
    [
        (1, 6e-4, 0.05, Event.MISSED),
        (4, 6e-4, 0.015, Event.MISSED),
        (1, 0.005, 0.008, Event.MISSED),
        (1, 0.03, 0.02, Event.MATCHED),
    ],
)
def test_the_tolerance_of_the_heading_is_given(attempts, tolerance, heading, expected) -> None:
    known = {'offset': (0.0, 0.0), 'difference': 0.0, 'difference_slope': 0.3}
    known |= {'offset_deviation': 1e-3, 'heading_deviation': 1e-4, 'parallax': 0.0}
    seen = sight(heading_error=heading, **known)
    settled = {'settled': 9, 'settled_parallax': 0.0, 'attempts': attempts}
    state = seeing(in_phase(APPROACHING.phase), measurement=seen, **settled)
    assert classify(state, replace(SETTINGS, arrival_heading=tolerance)) is expected


def test_no_phase_of_it_turns_in_place() -> None:
    assert not any(phase.turns_in_place for phase in ON_ARCS.rows)
    assert Phase.ORIENTING not in ON_ARCS.transitions.values()


def test_its_transitions_are_those_of_one_motion_less_turns() -> None:
    without_baseline = ((phase, Event.NO_BASELINE) for phase in (Phase.WAITING, Phase.HOLDING))
    changed = {pair: to for pair, to in ON_ARCS.transitions.items() if to is not FREELY[pair]}
    assert changed == dict.fromkeys(without_baseline, Phase.RETREATING)
    assert not any(event is Event.TURNED for _, event in ON_ARCS.transitions)


@pytest.mark.parametrize('law', ['paper', 'corrected', 'full'])
def test_a_law_that_turns_in_place_is_refused_and_the_one_that_does_not_is_named(law: str) -> None:
    with pytest.raises(ValueError, match=r'choose a law that drives arcs \(smooth\)'):
        ServoSettings(**{**CAR, 'law': law})


def test_a_curvature_of_a_base_that_turns_in_place_is_refused() -> None:
    with pytest.raises(ValueError, match='max_curvature must be 0 for base differential_drive'):
        ServoSettings(max_curvature=1.667)


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
