"""Least time: what a base needs at least, and how a run's figures compare with it."""

from dataclasses import replace
import math

from hypothesis import given
from hypothesis import strategies as st
import pytest

from visual_servo_epipolar.core.geometry.motion import Pose, Twist
from visual_servo_epipolar.core.laws.phase import Phase
from visual_servo_epipolar.core.servo.run_log import (
    least_time,
    MotionLimits,
    RunLog,
    Sample,
    summarise,
)

LIMITS = MotionLimits(speed=0.4, backward=0.2, acceleration=0.25, deceleration=0.5)


def test_from_behind_it_is_the_way_at_full_speed_and_both_ramps() -> None:
    start = Pose.from_start(0.3, -4.0, 5.0)
    expected = start.distance / 0.4 + 0.2 * (1.0 / 0.25 + 1.0 / 0.5)
    assert least_time(start, LIMITS) == pytest.approx(expected)


@given(way=st.floats(1e-3, 10.0))
def test_a_short_way_is_driven_below_full_speed(way: float) -> None:
    time = LIMITS.time(way, 0.4)
    assert time >= way / 0.4
    assert time >= math.sqrt(2.0 * way * (1.0 / 0.25 + 1.0 / 0.5)) - 1e-9


@given(x=st.floats(0.2, 1.5), y=st.floats(0.0, 1.5))
def test_from_beside_it_is_a_way_back_and_one_ahead(x: float, y: float) -> None:
    assert least_time(Pose(x, y, 1.5), LIMITS) > y / 0.2 + 0.5 * x / 0.4


def run(speeds: list[float], phase: Phase = Phase.RETREATING) -> RunLog:
    """Return the record of a robot that drives along y at these speeds [m/s] for 0.1 s each."""
    y, samples = -10.0, []
    for number, speed in enumerate(speeds):
        samples.append(
            Sample(number * 100_000_000, Pose(0.0, y, 1.5), twist=Twist(speed, 0.0), phase=phase)
        )
        y += 0.1 * speed
    return RunLog((0.0, -10.0, 0.0), 0, samples, 'arrived', '', limits=LIMITS)


def test_a_standstill_on_the_way_counts_and_a_cusp_and_the_end_do_not() -> None:
    drive, stand = [0.4] * 10, [0.0] * 5
    assert summarise(run([*drive, *stand, *drive, *stand]))['standstills'] == 1
    assert summarise(run([*drive, 0.0, 0.0, *drive]))['standstills'] == 0


def test_a_robot_at_the_goal_that_neither_arrives_nor_fails_counts_its_time_there() -> None:
    away = run([0.02, -0.02] * 10)
    there = [replace(it, pose=replace(it.pose, y=it.pose.y + 10.015)) for it in away.samples]
    arrived = [replace(it, phase=Phase.ARRIVED) for it in there]
    assert summarise(away)['standing_s'] == 0.0
    assert summarise(replace(away, samples=there))['standing_s'] == pytest.approx(1.9)
    ended = replace(away, samples=[*there[:6], *arrived[6:]])
    assert summarise(ended)['standing_s'] == pytest.approx(0.6)


def test_a_reversal_is_a_change_of_sign_of_commands_that_move_something() -> None:
    log = run([0.3, 0.009, -0.009, 0.0, 0.3, -0.02, 0.0, 0.02])
    turning = [
        replace(it, twist=Twist(it.twist.linear, w))
        for it, w in zip(log.samples, [0.1, -0.04, 0.1, -0.1, 0, 0, 0, -0.1], strict=True)
    ]
    assert summarise(replace(log, samples=turning))['reversals'] == {'v': 2, 'w': 1}


def test_jerk_is_the_second_difference_of_commands() -> None:
    result = summarise(run([0.0, 0.0, 0.1, 0.2, 0.2]))
    assert result['peak_jerk_m_s3'] == pytest.approx(10.0)
    assert result['peak_jerk_rad_s3'] == 0.0
    assert result['time_ratio'] == pytest.approx(0.4 / result['least_time_s'])


def test_without_limits_nobody_knows_the_least_time() -> None:
    log = run([0.4] * 5)
    result = summarise(RunLog(log.start, 0, log.samples, 'arrived', ''))
    assert result['least_time_s'] is None
    assert result['time_ratio'] is None
