"""One motion of a car: from beside its goal, bounded in curvature and in reversals."""

from dataclasses import replace
from itertools import pairwise

import pytest
from servo_states import in_phase, seeing, sight

from visual_servo_epipolar.commands.arguments import rig_path
from visual_servo_epipolar.core.laws.on_arcs import ON_ARCS
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
