"""Peers as laws: each does what its theory promises, and the benchmark judges by ground truth."""

import math

from hypothesis import given, settings
import pytest
from strategies import floats, matches

from visual_servo_epipolar.core.geometry.motion import (
    integrate,
    Pose,
    saturate,
    STANDSTILL,
    Twist,
    wrap_angle,
)
from visual_servo_epipolar.core.laws.phase import Phase
from visual_servo_epipolar.core.servo.settings import ServoSettings
from visual_servo_epipolar.core.servo.state import ServoState
from visual_servo_epipolar.core.twoview.observation import Observation
from visual_servo_epipolar.evaluation.benchmarks import laws
from visual_servo_epipolar.evaluation.benchmarks.laws import (
    as_step,
    CLOSE,
    graceful,
    OFF_AXLE,
    polar,
    POSE_LAWS,
)

SETTINGS, DT = ServoSettings(), 0.02


@settings(max_examples=25)
@given(floats(-2.0, 2.0), floats(-4.0, 3.0), floats(-40.0, 40.0))
def test_the_polar_law_parks_from_everywhere(x, y, heading) -> None:
    pose = Pose.from_start(x, y, heading)
    for _ in range(6000):
        pose = integrate(pose, polar(pose, SETTINGS), DT)
    assert pose.distance < CLOSE
    assert abs(wrap_angle(pose.heading_error)) < 0.1


def test_a_peer_stands_where_it_loses_its_features_and_then_fails_at_its_limits_before() -> None:
    current, desired = matches(Pose.from_start(0.3, -3.0, 4.0), count=60)
    state, phases, step = ServoState(), [], as_step(lambda: Twist(9.0, -9.0))
    for i in range(70):
        seen = Observation(i * 10**8, current, desired, 769.0)
        few = Observation(i * 10**8, current[:5], desired[:5], 769.0)
        state = step(state, few if i else seen, SETTINGS)
        phases.append((state.phase, state.twist))
    limits = Twist(SETTINGS.max_linear, -SETTINGS.max_angular)
    assert phases[0][0] is Phase.MATCHING_FEATURES
    assert abs(phases[0][1].linear) <= limits.linear * (1.0 + 1e-12)
    assert limits.angular <= phases[0][1].angular < 0.0
    assert phases[1] == (Phase.HOLDING, STANDSTILL)
    assert all(twist == STANDSTILL for _, twist in phases[1:])
    assert state.phase is Phase.FAILED
    assert state.reason.startswith('lost the features: 5 features')


@pytest.mark.parametrize(('name', 'fate'), [('full', 'reached'), ('polar', 'reached')])
def test_a_run_is_judged_by_ground_truth(name: str, fate: str) -> None:
    run = laws.one_run(name, (0.4, -2.2, 3.0), 1)
    assert (run['law'], run['fate'], run['outcome']) == (name, fate, 'arrived')
    assert run['position_error_m'] <= laws.WRONG_M


def test_a_row_counts_what_was_reported_and_what_was_true() -> None:
    base = {
        'outcome': 'arrived',
        'start': [3.0, 4.0, 0.0],
        'position_error_m': 0.01,
        'heading_error_deg': -1.0,
        'path_length_m': 6.0,
        'duration_s': 20.0,
        'time_ratio': 1.5,
        'min_visible_features': 50,
        'fate': 'reached',
    }
    wrong = base | {'position_error_m': 0.3, 'fate': 'missed'}
    lost = base | {'outcome': 'failed', 'position_error_m': 2.0, 'fate': 'lost'}
    figures = laws.scores([base, wrong, lost, lost])
    assert (figures['reached'], figures['lost'], figures['wrong']) == (0.25, 0.5, 0.25)
    assert figures['path_ratio'] == pytest.approx(1.2)
    assert figures['position_median_m'] == pytest.approx(0.155)
    nothing = laws.scores([lost])
    assert math.isnan(nothing['path_ratio'])
    document = {
        'starts': 1,
        'longest_s': 120.0,
        'reached': {'position_m': 0.05, 'heading_deg': 2.0},
        'rows': [{'region': 'front', 'law': 'full'} | figures],
    }
    assert 'full' in laws.table(document)


@pytest.mark.parametrize('law', ['graceful', 'displaced'])
def test_on_the_axle_alone_the_heading_ends_at_the_goals(law: str) -> None:
    pose = Pose.from_start(0.8, -1.0, 0.0)
    for _ in range(1500):
        twist = saturate(
            POSE_LAWS[law](pose, SETTINGS),
            max_linear=SETTINGS.max_linear,
            max_angular=SETTINGS.max_angular,
        )
        pose = integrate(pose, twist, DT)
    left = abs(math.degrees(pose.heading_error))
    assert left < 0.01 if POSE_LAWS[law] is graceful else 2.0 < left < 10.0
    assert pose.distance == pytest.approx(OFF_AXLE * math.radians(left), abs=1e-3)
