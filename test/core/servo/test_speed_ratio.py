"""A part of the speeds, set on the way: the robot slows down by its ramps, on the same path."""

from dataclasses import replace
from itertools import pairwise

import pytest

from visual_servo_epipolar.core.geometry.motion import Twist
from visual_servo_epipolar.core.laws.phase import Phase
from visual_servo_epipolar.core.servo.settings import ServoSettings
from visual_servo_epipolar.core.servo.state import ServoState
from visual_servo_epipolar.core.servo.supervisor import _limited

SETTINGS, DT = ServoSettings(), 0.1
FAST = Twist(2.0, 0.5)
DRIVES = ServoState().changed(phase=Phase.ZEROING_EPIPOLES)


@pytest.mark.parametrize('ratio', [1.0, 0.5, 0.05])
def test_both_speeds_are_limited_to_it(ratio: float) -> None:
    settings = replace(SETTINGS, max_speed_ratio=ratio, speed_ramps=False)
    twist = _limited(FAST, Twist(0.0, 0.0), DT, DRIVES, settings)
    assert twist.linear == pytest.approx(ratio * SETTINGS.max_linear)
    assert twist.angular / twist.linear == pytest.approx(FAST.angular / FAST.linear)
    turn = _limited(Twist(0.0, -9.0), Twist(0.0, 0.0), DT, DRIVES, settings)
    assert turn.angular == pytest.approx(-ratio * SETTINGS.max_angular)


def test_lowered_on_the_way_it_is_reached_by_the_ramps() -> None:
    settings = replace(SETTINGS, max_speed_ratio=0.25)
    twist = Twist(SETTINGS.max_linear, 0.0)
    speeds = [twist.linear]
    while speeds[-1] > 0.1 + 1e-9:
        twist = _limited(Twist(2.0, 0.0), twist, DT, DRIVES, settings)
        speeds.append(twist.linear)
    steps = [before - after for before, after in pairwise(speeds)]
    assert max(steps) <= 2.0 * SETTINGS.max_acceleration * DT + 1e-9
    assert len(steps) == pytest.approx(0.3 / (2.0 * SETTINGS.max_acceleration * DT), abs=1.0)
    assert speeds[-1] == pytest.approx(0.25 * SETTINGS.max_linear)


@pytest.mark.parametrize('ratio', [0.0, 1.01, -0.5])
def test_it_is_a_part(ratio: float) -> None:
    with pytest.raises(ValueError, match='max_speed_ratio'):
        replace(SETTINGS, max_speed_ratio=ratio)
