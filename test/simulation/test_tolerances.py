"""Tolerances of the owner in closed loops: a coarser one is reached sooner, and is kept."""

from functools import cache
import math

from durations import few_of
import pytest

from visual_servo_epipolar.core.servo.run_log import RunLog, summarise
from visual_servo_epipolar.simulation.scenario import Scenario
from visual_servo_epipolar.simulation.views import drive

Start = tuple[float, float, float]

POSITION, HEADING = 0.005, math.radians(0.5)
NEAR, FAR, TURNED = (0.1, -1.0, 5.0), (0.3, -3.0, 10.0), (0.0, 0.0, -10.0)


@cache
def driven(law: str, start: Start, position: float = 0.0, heading: float = 6e-4) -> RunLog:
    """Return the record of a run that is to end within these tolerances."""
    told = {'law': law, 'arrival_position': position, 'arrival_heading': heading}
    return drive(Scenario().with_servo(told).seeded(0), start, 0)


def time_in(log: RunLog, phase: str) -> float:
    spans = summarise(log)['phases']
    return float(sum(span['end_s'] - span['start_s'] for span in spans if span['name'] == phase))


@pytest.mark.parametrize(
    ('law', 'start', 'sooner'),
    few_of(
        [
            ('full', NEAR, 0.9),
            ('full-memory', NEAR, 0.4),
            ('full-final_turn', NEAR, 0.9),
            ('full-line_following', NEAR, 1.5),
            ('paper', FAR, 0.5),
            ('corrected', FAR, 0.5),
            ('paper+discordant_turn+final_turn', FAR, 3.0),
        ],
        keep=(0, 6),
    ),
)
def test_who_asks_for_5_mm_and_half_a_degree_has_them_sooner(law, start, sooner) -> None:
    finest = summarise(driven(law, start))
    coarse = summarise(driven(law, start, POSITION, HEADING))
    assert (finest['outcome'], coarse['outcome']) == ('arrived', 'arrived')
    assert coarse['duration_s'] <= finest['duration_s'] - sooner
    assert coarse['position_error_m'] <= POSITION
    assert abs(coarse['heading_error_deg']) <= 0.5


@pytest.mark.parametrize('millimetres', few_of([2.0, 5.0, 10.0, 20.0], keep=(0, 3)))
def test_the_robot_ends_within_the_tolerance_that_is_told(millimetres: float) -> None:
    summary = summarise(driven('full', NEAR, 1e-3 * millimetres, HEADING))
    assert summary['outcome'] == 'arrived'
    assert 1e3 * summary['position_error_m'] <= millimetres


def test_a_turn_in_place_is_not_begun_within_the_tolerance() -> None:
    law = 'full-line_following'  # no other turns at the goal, but on the last centimetre
    assert time_in(driven(law, NEAR), 'orienting') > 0.5
    assert time_in(driven(law, NEAR, POSITION, HEADING), 'orienting') == 0.0


@pytest.mark.parametrize(('law', 'sooner'), [('full', 0.9), ('full-memory', 0.9)])
def test_a_pure_rotation_is_turned_back_no_farther_than_the_tolerance_asks(law, sooner) -> None:
    """Each tolerance for itself: that of the heading alone takes the last of the turn away."""
    finest, coarse = driven(law, TURNED), driven(law, TURNED, heading=HEADING)
    assert time_in(coarse, 'orienting') < time_in(finest, 'orienting') - sooner
    summary = summarise(coarse)
    assert summary['outcome'] == 'arrived'
    assert abs(summary['heading_error_deg']) <= 0.5
