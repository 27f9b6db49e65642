"""Peers by the true pose: a point off the axle moves at once; the least time from anywhere."""

import math

import pytest

from visual_servo_epipolar.core.geometry.motion import integrate, Pose, saturate
from visual_servo_epipolar.core.laws.smooth.steering import polar_pose
from visual_servo_epipolar.core.servo.run_log import MotionLimits
from visual_servo_epipolar.core.servo.settings import ServoSettings
from visual_servo_epipolar.evaluation.benchmarks.peers import (
    displaced,
    graceful,
    least_time,
    OFF_AXLE,
    POSE_LAWS,
)

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


def test_the_least_time_is_that_of_the_straight_way_where_it_leads_to_the_goal() -> None:
    limits = MotionLimits.of(SETTINGS, backward=SETTINGS.retreat_speed)
    straight = limits.time(3.0, limits.speed)
    assert least_time(Pose(0.0, -3.0, 0.5 * math.pi), SETTINGS) == pytest.approx(
        straight, rel=0.01
    )
    assert least_time(Pose(0.5, -3.0, 0.5 * math.pi), SETTINGS) > straight


@pytest.mark.parametrize('y', [0.4, 0.0, -0.3])
def test_beside_the_goal_the_least_way_begins_with_one_back(y: float) -> None:
    limits = MotionLimits.of(SETTINGS, backward=SETTINGS.retreat_speed)
    least = least_time(Pose(0.5, y, 0.5 * math.pi), SETTINGS)
    assert limits.time(max(y, 0.1), limits.backward) < least < 30.0
