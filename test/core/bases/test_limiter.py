"""Limiter: speeds, ramps, jerk and dead bands of any command; what is lowered holds at once."""

from dataclasses import replace

import pytest

from visual_servo_epipolar.core.bases.limiter import Limiter
from visual_servo_epipolar.core.geometry.motion import STANDSTILL, Twist
from visual_servo_epipolar.core.servo.settings import ServoSettings

SETTINGS, DT = ServoSettings(max_angular=1.0), 0.1


@pytest.mark.parametrize('jerk', [0.0, 0.5])
def test_a_limit_lowered_on_the_way_holds_at_once(jerk: float) -> None:
    lower = replace(SETTINGS, max_linear=0.1, max_jerk=jerk)
    limiter = Limiter(Twist(0.4, 0.2))
    for _ in range(5):  # and stays: an S-curve does not go on from the leap
        limiter = limiter.after(Twist(0.4, 0.2), DT, lower.drive)
        assert limiter.last.linear == pytest.approx(0.1)


def test_what_is_within_the_dead_band_is_added_up_to_pulses() -> None:
    settings, limiter, driven = replace(SETTINGS, dead_band_linear=0.06), Limiter(), 0.0
    for _ in range(60):
        limiter = limiter.after(Twist(0.04, 0.0), DT, settings.drive)
        assert limiter.last.linear in (0.0, 0.06)
        driven += limiter.last.linear
    assert driven == pytest.approx(60 * 0.04, rel=0.25)


def test_a_pause_is_no_time_to_speed_up_in() -> None:
    assert Limiter().ramp_step(3.0, 0.1) == pytest.approx(0.15)
    assert Limiter(Twist(0.1, 0.0)).ramp_step(0.3, 0.1) == 0.3
    assert Limiter().after(STANDSTILL, 0.0, SETTINGS.drive) == Limiter()
