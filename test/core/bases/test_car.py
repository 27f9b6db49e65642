"""Car: never turns without driving, bounded in curvature and steering, and waits at each cusp."""

from dataclasses import replace
import math

from hypothesis import given
from hypothesis import strategies as st
import pytest

from visual_servo_epipolar.core.bases.base import BaseLimits, turns_in_place
from visual_servo_epipolar.core.bases.registry import base_of
from visual_servo_epipolar.core.geometry.motion import STANDSTILL, Twist

DT = 0.09
LIMITS = BaseLimits(
    max_linear=0.4,
    max_angular=0.5,
    max_acceleration=0.25,
    max_angular_acceleration=1.2,
    dead_band_linear=0.02,
    dead_band_angular=0.05,
    max_curvature=1.667,
    wheelbase=0.33,
    steering_rate=1.0,
)
CAR = base_of('car', LIMITS)
SPEEDS = st.floats(-1.0, 1.0, allow_subnormal=False)
TWISTS = st.builds(Twist, SPEEDS, SPEEDS)


def steering(twist: Twist) -> float:
    return math.atan(LIMITS.wheelbase * twist.angular / twist.linear)


def is_driven(twist: Twist) -> bool:
    return abs(twist.angular) <= abs(twist.linear) * LIMITS.max_curvature + 1e-12


def test_it_does_not_turn_in_place() -> None:
    assert not turns_in_place(CAR)
    assert CAR.within_speed(Twist(0.0, 1.0)) == STANDSTILL


@given(TWISTS, TWISTS, st.sampled_from(['raise', 'zero', 'pulse']))
def test_no_command_turns_more_than_its_curvature(wanted: Twist, then: Twist, mode: str) -> None:
    first = CAR.within_acceleration(CAR.within_speed(wanted), STANDSTILL, DT)
    second = CAR.within_acceleration(CAR.within_speed(then), first, DT)
    last, _ = CAR.beyond_dead_band(Twist(second.linear, then.angular), STANDSTILL, mode=mode)
    assert all(map(is_driven, (CAR.within_speed(wanted), first, second, last)))


@given(TWISTS, TWISTS)
def test_the_wheels_are_steered_no_faster_than_they_can(wanted: Twist, before: Twist) -> None:
    before = CAR.within_speed(before)
    after = CAR.within_acceleration(CAR.within_speed(wanted), before, DT)
    if before.linear and after.linear:
        turned = abs(steering(after) - steering(before))
        assert turned <= LIMITS.steering_rate * DT + 1e-9


def test_at_a_cusp_it_waits_for_its_steering() -> None:
    twist, wanted = Twist(0.3, 0.5), Twist(-0.3, 0.5)  # from full left to full right
    way, fastest = 0.0, 0.0
    for _ in range(60):
        twist = CAR.within_acceleration(wanted, twist, DT)
        assert twist.linear != 0.0  # where the wheels stand nobody would know any more
        if twist.linear < 0.0 and abs(steering(twist) - steering(wanted)) > 1e-9:
            way, fastest = way - twist.linear * DT, max(fastest, -twist.linear)
    assert twist == wanted
    assert 0.0 < way < 0.09
    assert fastest < 0.7 * abs(wanted.linear)


def test_a_dead_band_keeps_the_curve() -> None:
    twist, _ = CAR.beyond_dead_band(Twist(0.01, 0.01), STANDSTILL, mode='raise')
    assert twist == Twist(0.02, 0.02)
    assert CAR.beyond_dead_band(Twist(0.01, 0.01), STANDSTILL, mode='zero')[0] == STANDSTILL


def test_a_car_without_a_curvature_is_refused() -> None:
    with pytest.raises(ValueError, match='max_curvature must be above 0 for base car, got 0'):
        base_of('car', replace(LIMITS, max_curvature=0.0))
