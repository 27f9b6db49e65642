"""Differential drive: limits of speed and acceleration, and what its motors do not follow."""

from dataclasses import replace

from hypothesis import given
from hypothesis import strategies as st
import pytest

from visual_servo_epipolar.core.bases.base import BaseLimits, turns_in_place
from visual_servo_epipolar.core.bases.differential_drive import DifferentialDrive
from visual_servo_epipolar.core.bases.registry import base_of
from visual_servo_epipolar.core.geometry.motion import STANDSTILL, Twist

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


def test_it_turns_in_place() -> None:
    assert turns_in_place(BASE)


@pytest.mark.parametrize('ratio', [1.0, 0.5])
def test_one_factor_keeps_the_curve(ratio: float) -> None:
    twist = BASE.within_speed(Twist(4.0, 3.0), ratio=ratio)
    assert twist.linear == pytest.approx(ratio)
    assert twist.angular == pytest.approx(0.75 * ratio)


def test_a_limit_that_is_lowered_on_the_way_holds_at_once() -> None:
    lower = DifferentialDrive(replace(BASE.limits, max_linear=0.3))
    assert lower.within_acceleration(Twist(0.3, 0.0), Twist(0.9, 0.0), 0.1) == Twist(0.3, 0.0)


def test_an_unknown_base_is_refused_with_the_names_there_are() -> None:
    with pytest.raises(ValueError, match="differential_drive, car, got 'hovercraft'"):
        base_of('hovercraft', BASE.limits)


@given(nominal=SPEEDS, last=SPEEDS)
def test_a_ramp_never_changes_faster_than_allowed(nominal: float, last: float) -> None:
    speed = BASE.within_acceleration(Twist(nominal, 0.0), Twist(last, 0.0), 0.1).linear
    limit = 0.1 if abs(nominal) < abs(last) or nominal * last < 0.0 else 0.05
    assert abs(speed - last) <= limit + 1e-12
    assert min(last, nominal) - 1e-12 <= speed <= max(last, nominal) + 1e-12


def test_a_ramp_arrives_at_the_nominal_twist() -> None:
    twist = STANDSTILL
    for _ in range(20):
        twist = BASE.within_acceleration(Twist(0.4, -0.5), twist, 0.1)
    assert twist == Twist(0.4, -0.5)


@pytest.mark.parametrize(
    ('mode', 'expected'), [('raise', Twist(0.02, -0.05)), ('zero', Twist(0.0, 0.0))]
)
def test_slower_commands_than_the_motors_follow(mode: str, expected: Twist) -> None:
    twist, residual = BASE.beyond_dead_band(Twist(0.001, -0.01), STANDSTILL, mode=mode)
    assert (twist, residual) == (expected, STANDSTILL)


@pytest.mark.parametrize('mode', ['raise', 'zero'])
def test_a_standstill_is_never_raised(mode: str) -> None:
    assert BASE.beyond_dead_band(STANDSTILL, STANDSTILL, mode=mode) == (STANDSTILL, STANDSTILL)


def test_pulses_have_the_nominal_average() -> None:
    residual, twists = STANDSTILL, []
    for _ in range(1000):
        twist, residual = BASE.beyond_dead_band(Twist(0.006, -0.035), residual, mode='pulse')
        twists.append(twist)
    assert {twist.linear for twist in twists} == {0.0, 0.02}
    assert sum(twist.linear for twist in twists) == pytest.approx(6.0, abs=0.02)
    assert sum(twist.angular for twist in twists) == pytest.approx(-35.0, abs=0.05)


@pytest.mark.parametrize('nominal', [Twist(0.02, -0.5), STANDSTILL])
def test_a_twist_that_the_motors_can_follow_is_not_changed(nominal: Twist) -> None:
    followed = BASE.beyond_dead_band(nominal, Twist(0.004, 0.004), mode='pulse')
    assert followed == (nominal, STANDSTILL)
