"""Arrivals: in one motion, before a near wall, and within the tolerances of the owner."""

from functools import cache, partial
import math
from pathlib import Path

from durations import few_of
import pytest
from strategies import CAMERA

from visual_servo_epipolar.commands.arguments import scenario_path
from visual_servo_epipolar.core.estimate.settings import DEPARTURES
from visual_servo_epipolar.core.servo.run_log import phase_spans, RunLog, summarise
from visual_servo_epipolar.core.servo.settings import ServoSettings
from visual_servo_epipolar.simulation.closed_loop import Loop, LoopSettings
from visual_servo_epipolar.simulation.point_world import PointSettings, PointWorld
from visual_servo_epipolar.simulation.rigs import SimulatedRig
from visual_servo_epipolar.simulation.scenario import load, Scenario
from visual_servo_epipolar.simulation.views import drive

CONFIG = Path(__file__).parents[2] / 'config' / 'scenarios'

in_long = partial(pytest.param, marks=pytest.mark.long)
Start = tuple[float, float, float]
FRONT = [(1.0, -3.0, 0.0), (-1.2, -2.6, -10.0), (0.0, -4.0, 12.0)]
BESIDE = [(0.25, 0.9, 10.0), (-0.6, -0.6, 0.0), (1.2, -0.5, -8.0)]


@cache
def driven(start: Start, memory: bool = True, **limits: float) -> RunLog:
    """Return the record of one run, driven once for all tests that look at it."""
    servo = ServoSettings(law='smooth', memory=memory, **limits)
    settings = LoopSettings(start=start, max_duration=120.0, servo=servo)
    return Loop(settings, PointWorld(PointSettings(), SimulatedRig(CAMERA), seed=0), CAMERA).run()


@pytest.mark.parametrize('start', [FRONT[0], *map(in_long, FRONT[1:])])
def test_from_the_front_it_is_one_motion_in_little_more_than_the_least_time(start: Start) -> None:
    log = driven(start)
    result = summarise(log)
    assert [span.name for span in phase_spans(log)] == ['approaching', 'arrived']
    assert result['time_ratio'] < 1.5
    assert result['standstills'] == 0
    assert result['max_distance_ratio'] <= 1.02
    assert result['min_visible_features'] >= 30
    assert result['position_error_m'] < 0.004
    assert abs(result['heading_error_deg']) < 0.1


@pytest.mark.parametrize('start', [BESIDE[0], *map(in_long, BESIDE[1:])])
def test_from_beside_it_backs_off_once_and_does_not_stand_at_the_cusp(start: Start) -> None:
    log = driven(start)
    result = summarise(log)
    names = [span.name for span in phase_spans(log)]
    assert names == ['retreating', 'approaching', 'arrived']
    assert result['standstills'] == 0
    assert result['position_error_m'] < 0.004


def test_by_two_views_alone_it_ends_as_the_second_step_does() -> None:
    log = driven(FRONT[0], memory=False)
    names = [span.name for span in phase_spans(log)]
    assert log.outcome == 'arrived'
    assert names[:2] == ['approaching', 'matching_features']
    assert summarise(log)['position_error_m'] < 0.006


def test_a_base_that_turns_by_pulses_is_not_through_while_it_faces_elsewhere() -> None:
    # D is zero on the way, too: with 37 deg to turn the motion has not ended.
    seed = 1281573172
    realistic = load(CONFIG / 'realistic.yaml').with_servo({'law': 'smooth'}).seeded(seed)
    log = drive(realistic, (2.249583, 1.286026, 88.947885), seed)
    assert log.outcome == 'arrived', log.reason


STARTS = [
    *((0.92, -2.58, 0.46), (-0.52, -2.03, -9.37), (1.19, -2.38, -14.44), (1.2, -1.0, 10.0)),
    *((1.32, -4.39, -5.66), (-1.4, -3.41, 8.8)),  # far off, places are noisy
]


@pytest.mark.parametrize('law', ['full', 'smooth'])
@pytest.mark.parametrize(('x', 'y', 'heading'), few_of(STARTS, keep=(1, 4)))
def test_the_robot_probes_and_arrives(x: float, y: float, heading: float, law: str) -> None:
    scenario = load(scenario_path('nearwall')).with_servo({'law': law})
    log = drive(scenario, (x, y, heading), 0)
    assert log.samples[-1].phase.value == 'arrived', log.reason
    assert log.samples[-1].pose.distance < 5e-3
    assert y > -2.0 or summarise(log)['max_distance_ratio'] < 1.3


def test_no_map_begins_with_the_other_geometry_of_a_wall() -> None:
    """The true one had stuck far off the driven way, and was compared with no twin of the twin."""
    scenario = load(scenario_path('nearwall')).with_servo({'law': 'smooth'})
    log = drive(scenario, (-1.25629, -4.382246, -9.348021), 1944441043)
    assert log.samples[-1].phase.value == 'arrived', log.reason
    assert log.samples[-1].pose.distance < 5e-3


POSITION, HEADING = 0.005, math.radians(0.5)
NEAR, FAR, TURNED = (0.1, -1.0, 5.0), (0.3, -3.0, 10.0), (0.0, 0.0, -10.0)
ALL_BUT_TURNS = ' '.join(sorted({*DEPARTURES} - {'discordant_turn', 'final_turn', 'new_attempts'}))


@cache
def within(
    start: Start, position: float = 0.0, heading: float = 6e-4, *, law: str = 'full', out: str = ''
) -> RunLog:
    """Return the record of a run within these tolerances, with departures left ``out``."""
    asked = {'law': law, 'arrival_position': position, 'arrival_heading': heading}
    return drive(
        Scenario().with_servo({**asked, **dict.fromkeys(out.split(), False)}).seeded(0), start, 0
    )


def time_in(log: RunLog, phase: str) -> float:
    spans = summarise(log)['phases']
    return float(sum(span['end_s'] - span['start_s'] for span in spans if span['name'] == phase))


@pytest.mark.parametrize(
    ('law', 'start', 'sooner'),
    few_of(
        [
            ({}, NEAR, 0.9),
            ({'out': 'memory'}, NEAR, 0.4),
            ({'out': 'final_turn'}, NEAR, 0.9),
            ({'out': 'line_following'}, NEAR, 1.5),
            ({'law': 'paper'}, FAR, 0.5),
            ({'law': 'corrected'}, FAR, 0.5),
            ({'out': ALL_BUT_TURNS}, FAR, 3.0),
        ],
        keep=(0, 6),
    ),
)
def test_tolerances_of_5_mm_and_half_a_degree_are_met_sooner(law, start, sooner) -> None:
    finest = summarise(within(start, **law))
    coarse = summarise(within(start, POSITION, HEADING, **law))
    assert (finest['outcome'], coarse['outcome']) == ('arrived', 'arrived')
    assert coarse['duration_s'] <= finest['duration_s'] - sooner
    assert coarse['position_error_m'] <= POSITION
    assert abs(coarse['heading_error_deg']) <= 0.5


@pytest.mark.parametrize('millimetres', few_of([2.0, 5.0, 10.0, 20.0], keep=(0, 3)))
def test_the_robot_ends_within_the_tolerance(millimetres: float) -> None:
    summary = summarise(within(NEAR, 1e-3 * millimetres, HEADING))
    assert summary['outcome'] == 'arrived'
    assert 1e3 * summary['position_error_m'] <= millimetres


def test_a_turn_in_place_is_not_begun_within_the_tolerance() -> None:
    out = 'line_following'  # without it nothing turns at the goal, but on the last centimetre
    assert time_in(within(NEAR, out=out), 'orienting') > 0.5
    assert time_in(within(NEAR, POSITION, HEADING, out=out), 'orienting') == 0.0


@pytest.mark.parametrize('out', ['', 'memory'])
def test_a_pure_rotation_is_turned_back_no_farther_than_the_tolerance_asks(out: str) -> None:
    """Each tolerance for itself: that of the heading alone takes the last of the turn away."""
    finest, coarse = within(TURNED, out=out), within(TURNED, heading=HEADING, out=out)
    assert time_in(coarse, 'orienting') < time_in(finest, 'orienting') - 0.9
    summary = summarise(coarse)
    assert summary['outcome'] == 'arrived'
    assert abs(summary['heading_error_deg']) <= 0.5
