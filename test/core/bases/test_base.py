"""Limits of jerk: S-curves that reach what is wanted, and never exceed it by much."""

from hypothesis import given
from hypothesis import strategies as st
import pytest

from visual_servo_epipolar.core.bases.base import within_jerk
from visual_servo_epipolar.core.geometry.motion import STANDSTILL, Twist

DT = 1.0 / 11.0

speeds = st.floats(-0.5, 0.5)


def followed(wanted: Twist, *, linear: float, angular: float, steps: int = 80) -> list[Twist]:
    """Return the velocities on the way from standstill to ``wanted``."""
    twists, acceleration = [STANDSTILL], STANDSTILL
    for _ in range(steps):
        before = twists[-1]
        twist = within_jerk(wanted, before, acceleration, DT, linear=linear, angular=angular)
        acceleration = Twist(
            (twist.linear - before.linear) / DT, (twist.angular - before.angular) / DT
        )
        twists.append(twist)
    return twists


@given(linear=speeds, angular=speeds, jerk=st.floats(0.2, 20.0))
def test_jerk_stays_within_its_limit_and_the_speed_is_reached(
    linear: float, angular: float, jerk: float
) -> None:
    twists = followed(Twist(linear, angular), linear=jerk, angular=jerk)
    for name in ('linear', 'angular'):
        speed = [getattr(twist, name) for twist in twists]
        rates = [0.0, *((b - a) / DT for a, b in zip(speed, speed[1:], strict=False))]
        jerks = [(b - a) / DT for a, b in zip(rates, rates[1:], strict=False)]
        wanted = getattr(Twist(linear, angular), name)
        assert max(map(abs, jerks)) <= jerk * (1.0 + 1e-6)
        assert speed[-1] == pytest.approx(wanted, abs=0.01)
        assert max(map(abs, speed)) <= abs(wanted) + jerk * DT * DT


def test_without_a_limit_nothing_changes() -> None:
    wanted = Twist(0.4, -0.3)
    assert within_jerk(wanted, STANDSTILL, Twist(1.0, 1.0), DT, linear=0.0, angular=0.0) == wanted
