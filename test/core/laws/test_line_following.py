"""Line following, and curvature that is steered against."""

import math

import pytest

from visual_servo_epipolar.core.estimate.base_model import Curvature
from visual_servo_epipolar.core.geometry.motion import integrate, Pose, Twist
from visual_servo_epipolar.core.laws import equations
from visual_servo_epipolar.core.servo.settings import ServoSettings
from visual_servo_epipolar.core.servo.state import ServoState
from visual_servo_epipolar.core.servo.supervisor import compensate_curvature


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
    for law, turn in (('full', 0.092), ('paper', 0.1)):
        twist = compensate_curvature(Twist(0.4, 0.1), state, ServoSettings(law=law))
        assert (twist.linear, twist.angular) == pytest.approx((0.4, turn))
