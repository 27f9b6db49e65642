"""Commands rise by what the time between their going out allows, whatever the stamps say."""

import pytest
from servo_rig import HandSetClock, Rig

from visual_servo_epipolar.core.servo.settings import ServoSettings
from visual_servo_epipolar.core.servo.step import LATE_S

ACCELERATION = ServoSettings().max_angular_acceleration


@pytest.fixture
def rig(bench) -> Rig:
    """Return a servo that drives, with a clock that stands."""
    rig = Rig(bench, stale_timeout=60.0)
    rig.node._commands._steady = HandSetClock()
    return rig.drive()


def rise(rig: Rig, seconds: float, stamps_ns: int) -> float:
    """Return how much faster it turns by an image so much later."""
    rig.node._commands._steady.now_ns += round(seconds * 1e9)
    before = abs(rig.node._state.twist.angular)
    rig.stamp_ns += stamps_ns
    rig.see()
    return abs(rig.node._state.twist.angular) - before


def test_an_image_right_after_the_last_command_gives_little_speed(rig) -> None:
    assert rise(rig, 0.0, 300_000_000) <= ACCELERATION * LATE_S + 1e-9


def test_an_image_in_its_time_gives_what_the_ramp_allows(rig) -> None:
    assert rise(rig, 0.09, 0) == pytest.approx(ACCELERATION * 0.0909, rel=0.01)


def test_where_time_waits_for_the_servo_stamps_alone_count(bench) -> None:
    rig = Rig(bench, watchdog=False)
    rig.node._commands._steady = HandSetClock()
    rig.drive()
    assert rise(rig, 0.0, 0) == pytest.approx(ACCELERATION * 0.0909, rel=0.01)
