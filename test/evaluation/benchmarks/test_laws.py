"""Peers as laws: each does what its theory promises, and the benchmark judges by ground truth."""

import math

from durations import few_of
from hypothesis import given, settings
from hypothesis import strategies as st
import numpy as np
import pytest
from strategies import floats, matched_points, matches, poses_behind_the_goal

from visual_servo_epipolar.core.geometry.epipolar import Bearings
from visual_servo_epipolar.core.geometry.motion import (
    integrate,
    Pose,
    saturate,
    STANDSTILL,
    Twist,
    wrap_angle,
)
from visual_servo_epipolar.core.laws.phase import Phase
from visual_servo_epipolar.core.laws.steering import polar_pose
from visual_servo_epipolar.core.servo.settings import ServoSettings
from visual_servo_epipolar.core.servo.state import ServoState
from visual_servo_epipolar.core.twoview.observation import Observation
from visual_servo_epipolar.evaluation.benchmarks import laws
from visual_servo_epipolar.evaluation.benchmarks.laws import (
    ALIGN,
    CLOSE,
    DEPTH,
    displaced,
    graceful,
    nearby_pose,
    OFF_AXLE,
    PEERS,
    PeerState,
    POINT_GAIN,
    points,
    polar,
    POSE_LAWS,
    relative_distance,
    RelativePose,
)

NEARLY = st.builds(Pose.from_start, floats(-0.02, 0.02), floats(-0.02, 0.02), floats(-0.5, 0.5))


def reading_of(pose: Pose, depth: float) -> RelativePose:
    return RelativePose(pose.distance / depth, math.atan2(pose.y, pose.x), pose.heading_error)


def seen_of_a_wall(desired: np.ndarray, pose: Pose, ahead_m: float) -> np.ndarray:
    """Return the rays, (N, 2), of a wall ahead of the goal that has them as ``desired``."""
    wall = np.column_stack([desired, np.ones(len(desired))]) * ahead_m
    moved = wall - [pose.x, 0.0, pose.y]
    alpha = pose.heading_error
    right = np.array([math.cos(alpha), 0.0, math.sin(alpha)])
    ahead = np.array([-math.sin(alpha), 0.0, math.cos(alpha)])
    return np.column_stack([moved @ right, moved[:, 1]]) / (moved @ ahead)[:, None]


@given(poses_behind_the_goal())
def test_the_distance_over_the_depth_is_read_from_the_parallax(pose: Pose) -> None:
    current, desired = matched_points(pose)
    # matched_points() keeps no depths: scale the whole scene instead, and the reading must follow.
    near = relative_distance(current, desired, Bearings.from_pose(pose))
    assert near > 0.0
    current = seen_of_a_wall(desired, pose, 9.0)
    estimated = relative_distance(current, desired, Bearings.from_pose(pose))
    assert estimated == pytest.approx(pose.distance / 9.0, rel=1e-9)


@given(NEARLY)
def test_close_to_the_goal_the_pose_is_read_to_first_order(pose: Pose) -> None:
    rng = np.random.default_rng(3)
    desired = rng.uniform(-0.8, 0.8, (40, 2))
    current, alpha = seen_of_a_wall(desired, pose, 4.0), pose.heading_error
    estimated = nearby_pose(current, desired)
    # Second order in 0.7 % of the depth and 0.5 deg.
    assert 4.0 * estimated.distance * math.cos(estimated.psi) == pytest.approx(pose.x, abs=1.5e-3)
    assert 4.0 * estimated.distance * math.sin(estimated.psi) == pytest.approx(pose.y, abs=1.5e-3)
    assert estimated.heading_error == pytest.approx(alpha, abs=3e-4)


@given(floats(-3.0, 3.0), floats(-3.0, 3.0), floats(-3.0, 3.0))
def test_a_reading_says_where_the_goal_is_in_the_frame_of_the_robot(x, y, theta) -> None:
    pose = Pose(x, y, theta)
    estimated = reading_of(pose, 1.0)
    ahead = -(x * math.cos(theta) + y * math.sin(theta))
    assert estimated.ahead == pytest.approx(ahead, abs=1e-12)


@settings(max_examples=25)
@given(floats(-2.0, 2.0), floats(-4.0, 3.0), floats(-40.0, 40.0), floats(0.5, 2.0))
def test_the_polar_law_parks_from_everywhere_with_a_wrong_depth_too(x, y, heading, wrong) -> None:
    pose, dt = Pose.from_start(x, y, heading), 0.02
    backwards = reading_of(pose, 1.0).ahead < 0.0
    for _ in range(6000):
        # The depth that it believes in is off: the gain of the distance is, no more.
        twist = polar(reading_of(pose, DEPTH * wrong), backwards=backwards, close=1e-3)
        pose = integrate(pose, twist, dt)
    assert pose.distance < 0.02
    assert abs(wrap_angle(pose.heading_error)) < 0.1


@given(floats(0.05, 3.0), floats(-3.0, 3.0), floats(-1.0, 1.0))
def test_the_polar_law_decreases_its_lyapunov_function(distance, psi, heading) -> None:
    pose = Pose(distance * math.cos(psi), distance * math.sin(psi), heading + math.pi / 2.0)

    def lyapunov(at: Pose) -> float:
        toward = wrap_angle(math.atan2(at.y, at.x) + math.pi - math.pi / 2.0)
        against = wrap_angle(toward - at.heading_error)
        return 0.5 * (at.distance**2 + against**2 + ALIGN * toward**2)

    twist = polar(reading_of(pose, DEPTH))
    before, after = lyapunov(pose), lyapunov(integrate(pose, twist, 1e-5))
    jumps = abs(after - before) > 1.0  # an angle passed pi
    assert jumps or distance <= CLOSE or after <= before + 1e-12


@given(floats(-0.3, 0.3), floats(-15.0, 15.0))
def test_the_classical_law_is_right_along_what_the_robot_can_do(ahead, heading) -> None:
    rng = np.random.default_rng(5)
    desired = rng.uniform(-0.6, 0.6, (30, 2))
    u, v = desired.T
    turn = math.radians(0.1 * heading)
    # The image after a small move ahead and a small turn to the left, to first order.
    moved = np.stack(
        [
            u + u * ahead * 0.1 / DEPTH + (1.0 + u * u) * turn,
            v + v * ahead * 0.1 / DEPTH + u * v * turn,
        ],
        axis=1,
    )
    twist = points(moved, desired)
    # The columns are those of the current image: second order in 6 mm rad and 26 mrad.
    assert twist.linear == pytest.approx(-POINT_GAIN * 0.1 * ahead, abs=0.01)
    assert twist.angular == pytest.approx(-POINT_GAIN * turn, abs=1e-3)


def test_the_classical_law_cannot_remove_a_lateral_error_of_a_distant_wall() -> None:
    desired = np.random.default_rng(6).uniform(-0.6, 0.6, (200, 2))
    sideways = desired - [0.1, 0.0]  # as if 0.5 m to the right of the goal, at 5 m
    twist = points(sideways, desired)
    assert twist.angular > 0.0  # it turns, which leaves the robot where it is
    assert abs(twist.linear) < 0.05


def test_a_peer_stands_still_where_there_are_too_few_features() -> None:
    law, few = PEERS['image-based'], np.tile([0.0, 0.0, 1.0], (5, 1))
    state = ServoState()
    for i in range(3):
        state = law(state, Observation(i * 10**8, few, few, 769.0), ServoSettings())
    assert state.phase is Phase.WAITING
    assert state.twist == STANDSTILL


@pytest.mark.parametrize('name', [name for name in PEERS if name != 'ours'])
def test_a_peer_that_loses_its_features_holds_and_then_fails(name: str) -> None:
    pose = Pose.from_start(0.3, -3.0, 4.0)
    current, desired = matches(pose, count=60)
    state = PEERS[name](ServoState(), Observation(0, current, desired, 769.0), ServoSettings())
    assert isinstance(state, PeerState)
    assert state.phase is Phase.MATCHING_FEATURES
    assert state.twist != STANDSTILL
    phases = []
    for i in range(1, 70):
        few = Observation(i * 10**8, current[:5], desired[:5], 769.0)
        state = PEERS[name](state, few, ServoSettings())
        assert state.twist == STANDSTILL
        phases.append(state.phase)
    assert phases[0] is Phase.HOLDING
    assert state.phase is Phase.FAILED
    assert state.reason.startswith('lost the features: 5 features')


@pytest.mark.parametrize(
    ('name', 'fate'),
    few_of(
        [('ours', 'reached'), ('position-based', 'reached'), ('image-based', 'missed')],
        keep=(0, 2),
    ),
)
def test_a_run_is_judged_by_ground_truth(name: str, fate: str) -> None:
    run = laws.one_run(name, (0.4, -2.2, 3.0), 1)
    assert run['law'] == name
    assert run['fate'] == fate
    assert (run['position_error_m'] <= laws.WRONG_M) == (fate == 'reached')
    # Nobody says "arrived" who is not.
    assert (run['outcome'] == 'arrived') == (fate == 'reached')


def test_a_row_counts_what_was_said_and_what_was_true() -> None:
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
        'rows': [{'region': 'front', 'law': 'ours'} | figures],
    }
    assert 'ours' in laws.table(document)


def test_the_twist_of_a_peer_obeys_the_limits() -> None:
    pose = Pose.from_start(0.8, -4.0, 10.0)
    current, desired = matches(pose, count=60)
    limits = ServoSettings()
    for law in PEERS.values():
        state = law(ServoState(), Observation(0, current, desired, 769.0), limits)
        assert isinstance(state.twist, Twist)
        assert abs(state.twist.linear) <= limits.max_linear * (1.0 + 1e-12)
        assert abs(state.twist.angular) <= limits.max_angular


SETTINGS, DT = ServoSettings(), 0.02


def point(pose: Pose) -> tuple[float, float]:
    """Return the point off the axle, from where it is at the goal."""
    turned = pose.heading_error
    return pose.x - OFF_AXLE * math.sin(turned), pose.y + OFF_AXLE * (math.cos(turned) - 1.0)


@pytest.mark.parametrize('x', [0.8, -0.8])
def test_the_desired_epipole_falls_at_once_where_the_current_one_is_zero(x: float) -> None:
    ahead = OFF_AXLE * math.cos(math.atan2(x, 2.0))
    pose = Pose.from_start(x, -2.0, math.degrees(math.atan2(x, 2.0 - ahead)))
    before = polar_pose(*point(pose), pose.heading_error)
    turned = Pose(pose.x, pose.y, pose.theta + before.delta * -1.0)  # e_au = 0
    start = polar_pose(*point(turned), turned.heading_error)
    after = integrate(turned, displaced(turned, SETTINGS), 1e-3)
    assert abs(polar_pose(*point(after), 0.0).phi) < abs(start.phi) - 1e-6


@pytest.mark.parametrize('law', POSE_LAWS)
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
