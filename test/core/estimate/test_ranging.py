"""Ranging by two bearings and the path between, and line following."""

import math

from hypothesis import assume, given
from hypothesis import strategies as st
import pytest

from visual_servo_epipolar.core.estimate.base_model import Curvature
from visual_servo_epipolar.core.geometry.epipolar import Bearings
from visual_servo_epipolar.core.geometry.motion import integrate, Pose, Twist, wrap_angle
from visual_servo_epipolar.core.laws import equations
from visual_servo_epipolar.core.odometry.ranging import Leg, MIN_TURN
from visual_servo_epipolar.core.servo.settings import ServoSettings
from visual_servo_epipolar.core.servo.state import ServoState
from visual_servo_epipolar.core.servo.supervisor import compensate_curvature


@given(
    x=st.floats(-2.0, 2.0),
    y=st.floats(-6.0, -0.5),
    heading=st.floats(-0.8, 0.8),
    travel=st.floats(0.1, 2.0),
)
def test_two_bearings_and_the_path_between_give_the_distance(x, y, heading, travel) -> None:
    start = Pose(x, y, math.pi / 2 + heading)
    end = integrate(start, Twist(travel, 0.0), 1.0)
    assume(end.distance > 0.05)  # at the goal there are no bearings
    before, after = Bearings.from_pose(start), Bearings.from_pose(end)
    assume(abs(wrap_angle(after.psi - before.psi)) > 1.01 * MIN_TURN)
    assume(abs(wrap_angle(after.psi - before.psi)) < 3.0)
    leg = Leg(before.psi).extended(before, travel)
    assert leg.distance(after.psi) == pytest.approx(end.distance, abs=1e-9)


def test_a_straight_approach_says_nothing_about_the_distance() -> None:
    bearings = Bearings.from_pose(Pose(0.0, -3.0, math.pi / 2))
    assert Leg(bearings.psi).extended(bearings, 1.0).distance(bearings.psi) is None


@pytest.mark.parametrize('speed', [0.4, -0.4])
def test_following_the_line_removes_offset_and_heading_at_either_sign_of_speed(speed) -> None:
    pose = Pose(0.05, -4.0 if speed > 0 else 0.0, math.pi / 2 - 0.03)
    for _ in range(900):
        twist = equations.follow_line(speed, pose.x, pose.heading_error, look_ahead=0.5)
        pose = integrate(pose, twist, 0.01)
    # 3.6 m are 7 look-aheads: exp(-0.9 * 7) of 50 mm is 0.1 mm.
    assert abs(pose.x) < 2e-4
    assert abs(pose.heading_error) < 1e-3


def test_a_known_curvature_is_steered_against() -> None:
    state = ServoState().changed(curvature=Curvature(0.02))
    assert compensate_curvature(Twist(0.4, 0.1), state, ServoSettings()).angular == pytest.approx(
        0.092
    )
    assert compensate_curvature(Twist(0.4, 0.1), state, ServoSettings(law='paper')) == Twist(
        0.4, 0.1
    )
