"""One motion in whole runs: soon at the goal, without a standstill, with features in view."""

from functools import cache, partial
from pathlib import Path

import pytest
from strategies import CAMERA

from visual_servo_epipolar.core.servo.run_log import phase_spans, RunLog, summarise
from visual_servo_epipolar.core.servo.settings import ServoSettings
from visual_servo_epipolar.simulation.closed_loop import run
from visual_servo_epipolar.simulation.mounts.mounting import FixedRig
from visual_servo_epipolar.simulation.point_world import PointSettings, PointWorld
from visual_servo_epipolar.simulation.run_monitor import LoopSettings
from visual_servo_epipolar.simulation.scenario import load
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
    return run(settings, PointWorld(PointSettings(), FixedRig(CAMERA), seed=0), CAMERA)


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


def test_limits_of_jerk_hold_and_cost_little() -> None:
    usual = summarise(driven(FRONT[0]))
    result = summarise(driven(FRONT[0], max_jerk=2.0, max_angular_jerk=6.0))
    assert result['peak_jerk_m_s3'] <= 2.0 + 1e-6
    assert result['peak_jerk_rad_s3'] <= 6.0 + 1e-6
    assert result['duration_s'] < usual['duration_s'] + 1.0
    assert result['outcome'] == 'arrived'


def test_a_base_that_turns_by_pulses_is_not_through_while_it_faces_elsewhere() -> None:
    # D is zero on the way, too: with 37 deg to turn the motion has not ended.
    seed = 1281573172
    realistic = load(CONFIG / 'realistic.yaml').with_servo({'law': 'smooth'}).seeded(seed)
    log = drive(realistic, (2.249583, 1.286026, 88.947885), seed)
    assert log.outcome == 'arrived', log.reason
