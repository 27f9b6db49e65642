"""A simulated car: what its steering does to commands."""

import math

import pytest

from visual_servo_epipolar.core.geometry.motion import Pose, Twist
from visual_servo_epipolar.core.laws.command import Command
from visual_servo_epipolar.simulation.bases.ackermann import Ackermann, AckermannSettings


def car(**changes: float) -> Ackermann:
    plain = {'command_timeout': 0.0, 'odometry_noise': 0.0}
    return Ackermann(AckermannSettings(**(plain | changes)), Pose(0.0, 0.0, 0.0), seed=0)


def driven(robot: Ackermann, twist: Twist, seconds: float) -> Ackermann:
    robot.command(Command(twist))
    robot.advance(robot.now_ns + round(seconds * 1e9))
    return robot


def test_a_turn_without_speed_steers_and_moves_nothing() -> None:
    robot = driven(car(), Twist(0.0, 0.3), 2.0)
    assert robot.pose == Pose(0.0, 0.0, 0.0)
    assert robot.steering == robot.settings.max_steering


def test_it_drives_no_tighter_circle_than_its_steering_allows() -> None:
    robot = driven(car(), Twist(0.2, 1.5), 5.0)
    tightest = math.tan(robot.settings.max_steering) / robot.settings.wheelbase
    assert robot.twist.angular / robot.twist.linear == pytest.approx(tightest)


def test_its_wheels_take_their_time() -> None:
    robot = driven(car(steering_rate=0.5), Twist(0.2, 0.2), 0.4)
    assert robot.steering == pytest.approx(0.2)


def test_wheels_that_are_not_straight_pull_aside_unseen_by_odometry() -> None:
    robot = driven(car(steering_offset=0.05), Twist(0.2, 0.0), 5.0)
    assert robot.pose.theta > 0.05
    assert robot.odometry.theta == 0.0
