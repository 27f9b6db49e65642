"""Commands to a car as ackermann_msgs: what they say, and to which base they go."""

from importlib.util import find_spec
import math
from types import SimpleNamespace

import pytest

from visual_servo_epipolar.core.geometry.motion import STANDSTILL, Twist
from visual_servo_epipolar.messages import write
from visual_servo_epipolar.nodes.servo_node import ServoNode

CAR = {'law': 'smooth', 'base': 'car', 'max_curvature': 1.0}


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


@pytest.mark.parametrize(('values', 'steers'), [(CAR, True), ({}, False)])
def test_a_base_that_steers_is_sent_it_where_its_package_is_installed(
    bench, values, steers
) -> None:
    installed = find_spec('ackermann_msgs') is not None
    names = {item.topic_name for item in bench.start(ServoNode, **values).publishers}
    assert ('/ackermann_cmd' in names) is (steers and installed)


def test_the_parameter_that_asked_for_it_is_answered_by_the_base(bench) -> None:
    with pytest.raises(ValueError, match='ackermann -> base: car'):
        bench.start(ServoNode, ackermann=True)
    bench.start(ServoNode, ackermann=False)  # as files of earlier versions have it
