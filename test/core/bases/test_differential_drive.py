"""Differential drive: limits of speed and acceleration, and what its motors do not follow."""

from dataclasses import replace
import math

from hypothesis import given
from hypothesis import strategies as st
import pytest

from visual_servo_epipolar.core.bases.base import BaseLimits, turns_in_place
from visual_servo_epipolar.core.bases.differential_drive import DifferentialDrive
from visual_servo_epipolar.core.bases.limiter import Limiter
from visual_servo_epipolar.core.bases.registry import base_of
from visual_servo_epipolar.core.geometry.motion import STANDSTILL, Twist
from visual_servo_epipolar.core.servo.settings import ServoSettings

BASE = DifferentialDrive(
    BaseLimits(
        max_linear=1.0,
        max_angular=1.5,
        max_acceleration=0.5,
        max_angular_acceleration=1.0,
        dead_band_linear=0.02,
        dead_band_angular=0.05,
    )
)
SPEEDS = st.floats(-1.0, 1.0, allow_subnormal=False)


@pytest.mark.parametrize('ratio', [1.0, 0.5])
def test_one_factor_keeps_the_curve(ratio: float) -> None:
    twist = BASE.within_speed(Twist(4.0, 3.0), ratio=ratio)
    assert twist.linear == pytest.approx(ratio)
    assert twist.angular == pytest.approx(0.75 * ratio)


def test_an_unknown_base_is_refused_with_the_names_there_are() -> None:
    with pytest.raises(ValueError, match="differential_drive, car, got 'hovercraft'"):
        base_of('hovercraft', BASE.limits)


@given(nominal=SPEEDS, last=SPEEDS)
def test_a_ramp_never_changes_faster_than_allowed(nominal: float, last: float) -> None:
    speed = BASE.within_acceleration(Twist(nominal, 0.0), Twist(last, 0.0), 0.1).linear
    limit = 0.1 if abs(nominal) < abs(last) or nominal * last < 0.0 else 0.05
    assert abs(speed - last) <= limit + 1e-12
    assert min(last, nominal) - 1e-12 <= speed <= max(last, nominal) + 1e-12


@pytest.mark.parametrize(
    ('mode', 'expected'), [('raise', Twist(0.02, -0.05)), ('zero', Twist(0.0, 0.0))]
)
def test_slower_commands_than_the_motors_follow(mode: str, expected: Twist) -> None:
    twist, residual = BASE.beyond_dead_band(Twist(0.001, -0.01), STANDSTILL, mode=mode)
    assert (twist, residual) == (expected, STANDSTILL)
    assert BASE.beyond_dead_band(STANDSTILL, STANDSTILL, mode=mode) == (STANDSTILL, STANDSTILL)


def test_pulses_have_the_nominal_average() -> None:
    residual, twists = STANDSTILL, []
    for _ in range(1000):
        twist, residual = BASE.beyond_dead_band(Twist(0.006, -0.035), residual, mode='pulse')
        twists.append(twist)
    assert {twist.linear for twist in twists} == {0.0, 0.02}
    assert sum(twist.linear for twist in twists) == pytest.approx(6.0, abs=0.03)
    assert sum(twist.angular for twist in twists) == pytest.approx(-35.0, abs=0.1)


def test_what_swings_about_zero_is_no_reason_for_pulses_to_and_fro() -> None:
    residual, pulses = STANDSTILL, 0
    for frame in range(100):
        wanted = Twist(0.0, 0.03 if frame % 2 else -0.025)
        twist, residual = BASE.beyond_dead_band(wanted, residual, mode='pulse')
        pulses += twist.angular != 0.0
        assert twist.angular >= 0.0
    assert 0 < pulses < 12


@pytest.mark.parametrize('nominal', [Twist(0.02, -0.5), STANDSTILL])
def test_a_twist_that_the_motors_can_follow_is_not_changed(nominal: Twist) -> None:
    followed = BASE.beyond_dead_band(nominal, Twist(0.004, 0.004), mode='pulse')
    assert followed == (nominal, STANDSTILL)


DT_CAR = 0.09
SLOW = {'max_linear': 0.4, 'max_angular': 0.5, 'max_acceleration': 0.25}
LIMITS = replace(BASE.limits, max_curvature=1.667, **SLOW)
CAR = base_of('car', LIMITS)
TWISTS = st.builds(Twist, SPEEDS, SPEEDS)


def steering(twist: Twist) -> float:
    return math.atan(LIMITS.wheelbase * twist.angular / twist.linear)


def test_it_does_not_turn_in_place() -> None:
    assert turns_in_place(BASE) and not turns_in_place(CAR)
    assert CAR.within_speed(Twist(0.0, 1.0)) == STANDSTILL


@given(TWISTS, TWISTS, st.sampled_from(['raise', 'zero', 'pulse']))
def test_no_command_turns_more_than_its_curvature(wanted: Twist, then: Twist, mode: str) -> None:
    first = CAR.within_acceleration(CAR.within_speed(wanted), STANDSTILL, DT_CAR)
    second = CAR.within_acceleration(CAR.within_speed(then), first, DT_CAR)
    last, _ = CAR.beyond_dead_band(Twist(second.linear, then.angular), STANDSTILL, mode=mode)
    for it in (CAR.within_speed(wanted), first, second, last):
        assert abs(it.angular) <= abs(it.linear) * LIMITS.max_curvature + 1e-12


@given(TWISTS, TWISTS)
def test_the_wheels_are_steered_no_faster_than_they_can(wanted: Twist, before: Twist) -> None:
    before = CAR.within_speed(before)
    after = CAR.within_acceleration(CAR.within_speed(wanted), before, DT_CAR)
    if before.linear and after.linear:
        turned = abs(steering(after) - steering(before))
        assert turned <= LIMITS.steering_rate * DT_CAR + 1e-9


def test_at_a_cusp_it_waits_for_its_steering() -> None:
    twist, wanted = Twist(0.3, 0.5), Twist(-0.3, 0.5)  # from full left to full right
    way, fastest = 0.0, 0.0
    for _ in range(60):
        twist = CAR.within_acceleration(wanted, twist, DT_CAR)
        assert twist.linear != 0.0  # where the wheels stand nobody would know any more
        if twist.linear < 0.0 and abs(steering(twist) - steering(wanted)) > 1e-9:
            way, fastest = way - twist.linear * DT_CAR, max(fastest, -twist.linear)
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


SETTINGS, TENTH = ServoSettings(max_angular=1.0), 0.1


def test_a_limit_lowered_on_the_way_holds_at_once() -> None:
    lower = replace(SETTINGS, max_linear=0.1)
    limiter = Limiter(Twist(0.4, 0.2)).after(Twist(0.4, 0.2), TENTH, lower.drive)
    assert limiter.last.linear == pytest.approx(0.1)


def test_a_pause_is_no_time_to_speed_up_in() -> None:
    assert Limiter().ramp_step(3.0, 0.1) == pytest.approx(0.15)
    assert Limiter(Twist(0.1, 0.0)).ramp_step(0.3, 0.1) == 0.3
    assert Limiter().after(STANDSTILL, 0.0, SETTINGS.drive) == Limiter()
