"""Commands to a car as ackermann_msgs: what they say, and when they are refused."""

import math
from types import SimpleNamespace

import pytest

from visual_servo_epipolar.core.geometry.motion import STANDSTILL, Twist
from visual_servo_epipolar.core.servo.settings import ServoSettings
from visual_servo_epipolar.messages import write
from visual_servo_epipolar.nodes.servoing.commands import refuse_ackermann
from visual_servo_epipolar.nodes.startup.settings import ServoNodeSettings

CAR = ServoSettings(law='smooth', base='car', max_curvature=1.0)


def kind(header: object) -> SimpleNamespace:
    """Return the fields of an AckermannDriveStamped that are filled; its package is no wheel."""
    return SimpleNamespace(header=header, drive=SimpleNamespace(speed=0.0, steering_angle=0.0))


@pytest.mark.parametrize('speed', [0.3, -0.3])
def test_a_curve_to_the_left_steers_left_forward_and_backward(speed: float) -> None:
    message = write.ackermann_drive(kind, Twist(speed, speed * 0.8), 0.5, 0, 'base_link')
    assert message.drive.speed == speed
    assert math.tan(message.drive.steering_angle) == pytest.approx(0.5 * 0.8)


def test_who_stands_steers_straight() -> None:
    message = write.ackermann_drive(kind, STANDSTILL, 0.5, 0, 'base_link')
    assert (message.drive.speed, message.drive.steering_angle) == (0.0, 0.0)


def test_it_is_refused_of_a_base_that_turns_in_place() -> None:
    with pytest.raises(ValueError, match='ackermann must go with a base that steers'):
        refuse_ackermann(ServoNodeSettings(ackermann=True), ServoSettings())


def test_where_the_package_is_missing_it_says_so() -> None:
    pytest.importorskip('rclpy')
    try:
        import ackermann_msgs  # noqa: F401, PLC0415
    except ImportError:
        with pytest.raises(ValueError, match='ackermann_msgs cannot be imported; install'):
            refuse_ackermann(ServoNodeSettings(ackermann=True), CAR)


def test_nobody_is_asked_for_what_is_not_wanted() -> None:
    refuse_ackermann(ServoNodeSettings(), ServoSettings())
