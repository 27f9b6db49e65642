"""Simulated bases: limits, faults of the wheels, steering, odometry, and the watchdog."""

import math
from typing import TypeVar

from hypothesis import given, settings
from hypothesis import strategies as st
import numpy as np
import pytest
from strategies import floats, twists

from visual_servo_epipolar.core.geometry.motion import integrate, Pose, STANDSTILL, Twist
from visual_servo_epipolar.core.rigs.rig import Command
from visual_servo_epipolar.simulation.bases import (
    Ackermann,
    AckermannSettings,
    Nod,
    OVERSHOOT,
    Pioneer,
    PioneerSettings,
)

Base = TypeVar('Base', bound=Pioneer)
START = Pose(0.0, 0.0, 0.0)
SUBSTEP = 0.01  # [s] velocities are held this long
PLAIN = {'command_timeout': 0.0, 'odometry_noise': 0.0}


def ns(seconds: float) -> int:
    return round(seconds * 1e9)


def base(*, seed: int = 0, **changes: float) -> Pioneer:
    """Return a base without odometry noise that never times out, but for ``changes``."""
    return Pioneer(PioneerSettings(**(PLAIN | changes)), START, seed=seed)


def driven(robot: Base, twist: Twist, seconds: float) -> Base:
    """Command ``twist`` once, and let ``seconds`` pass."""
    robot.command(Command(twist))
    robot.advance(robot.now_ns + ns(seconds))
    return robot


@settings(max_examples=30)
@given(st.lists(twists(), min_size=1, max_size=6))
def test_speeds_and_accelerations_stay_within_their_limits(wanted: list[Twist]) -> None:
    robot, before = base(), STANDSTILL
    limits = robot.settings
    for twist in wanted:
        robot.command(Command(twist))
        for _ in range(40):
            robot.advance(robot.now_ns + ns(SUBSTEP))
            now = robot.twist
            assert abs(now.linear) <= limits.max_linear + 1e-12
            assert abs(now.angular) <= limits.max_angular + 1e-12
            # Braking is the quicker of the two.
            assert abs(now.linear - before.linear) <= limits.deceleration * SUBSTEP + 1e-12
            turn = abs(now.angular - before.angular)
            assert turn <= limits.angular_acceleration * SUBSTEP + 1e-12
            before = now


@pytest.mark.parametrize('sign', [-1.0, 1.0])
def test_it_takes_its_time_to_speed_up_and_half_of_it_to_brake(sign: float) -> None:
    robot = driven(base(), Twist(sign * 0.3, 0.0), 0.98)
    assert abs(robot.twist.linear) < 0.3
    assert abs(driven(robot, Twist(sign * 0.3, 0.0), 0.04).twist.linear) == pytest.approx(0.3)
    assert driven(robot, STANDSTILL, 0.48).twist != STANDSTILL
    assert driven(robot, STANDSTILL, 0.04).twist == STANDSTILL


def test_a_command_beyond_the_limits_keeps_its_curve() -> None:
    robot = driven(base(), Twist(4.0, 2.0), 10.0)
    assert robot.twist.linear == pytest.approx(1.0)
    assert robot.twist.angular == pytest.approx(0.5)


@given(floats(-1.0, 1.0), floats(-1.7, 1.7), floats(0.001, 3.0))
@settings(max_examples=30)
def test_at_constant_speed_the_path_is_the_exact_arc(linear, angular, seconds) -> None:
    robot = driven(base(), Twist(linear, angular), 5.0)
    start = robot.pose
    robot.advance(robot.now_ns + ns(seconds))
    expected = integrate(start, Twist(linear, angular), ns(seconds) / 1e9)
    # Rounding over 300 substeps.
    assert (robot.pose.x, robot.pose.y) == pytest.approx((expected.x, expected.y), abs=1e-12)
    turn = math.remainder(robot.pose.theta - expected.theta, 2 * math.pi)
    assert turn == pytest.approx(0.0, abs=1e-12)


def test_a_base_that_was_never_commanded_stands() -> None:
    robot = base(command_timeout=0.5)
    robot.advance(ns(5.0))
    assert (robot.pose, robot.twist, robot.now_ns) == (START, STANDSTILL, ns(5.0))
    assert not robot.timed_out


@pytest.mark.parametrize('earlier', [0, -1, -(10**9)])
def test_time_that_does_not_advance_moves_nothing(earlier: int) -> None:
    robot = driven(base(), Twist(0.5, 0.2), 2.0)
    before = (robot.pose, robot.odometry, robot.twist, robot.now_ns)
    robot.advance(robot.now_ns + earlier)
    assert (robot.pose, robot.odometry, robot.twist, robot.now_ns) == before


def test_without_commands_the_watchdog_stops_the_base() -> None:
    robot = base(command_timeout=0.5)
    for _ in range(20):
        driven(robot, Twist(0.3, 0.5), 0.1)
    assert robot.twist != STANDSTILL
    assert not robot.timed_out
    last = robot.now_ns - ns(0.1)
    robot.advance(last + ns(0.5))
    assert robot.twist.linear == pytest.approx(0.3)
    # 0.3 m/s at 0.6 m/s^2, and two substeps: one to notice, one begun.
    robot.advance(last + ns(0.5 + 0.3 / 0.6 + 2.0 * SUBSTEP))
    assert robot.timed_out
    assert robot.twist == STANDSTILL


@pytest.mark.parametrize(('timeout', 'seconds'), [(0.2, 0.19), (0.0, 60.0)])
def test_commands_in_time_or_no_timeout_keep_the_base_going(timeout, seconds) -> None:
    robot = base(command_timeout=timeout)
    for _ in range(10):
        driven(robot, Twist(0.3, 0.0), seconds)
    assert robot.twist.linear == pytest.approx(0.3)


def test_halt_forgets_what_is_pending_and_brakes() -> None:
    robot = driven(base(command_delay=0.5), Twist(0.3, 0.0), 2.0)
    robot.command(Command(Twist(1.0, 1.0)))
    robot.halt()
    robot.advance(robot.now_ns + ns(2.0))
    assert robot.twist == STANDSTILL


@pytest.mark.parametrize(
    ('commanded', 'moves'),
    [
        ((0.049, 0.0), (0.0, 0.0)),
        ((0.0, -0.099), (0.0, 0.0)),
        ((-0.049, 0.099), (0.0, 0.0)),
        ((0.051, 0.099), (0.051, 0.0)),
    ],
)
def test_motors_stand_each_in_its_dead_zone(commanded, moves) -> None:
    robot = driven(base(dead_zone_linear=0.05, dead_zone_angular=0.1), Twist(*commanded), 2.0)
    assert (robot.twist.linear, robot.twist.angular) == pytest.approx(moves)


@pytest.mark.parametrize('linear', [0.3, -0.3])
@pytest.mark.parametrize('ratio', [1.01, 0.95])  # a larger right wheel curves to the left
def test_unequal_wheels_turn_by_their_difference_over_the_track(linear, ratio) -> None:
    robot = driven(base(wheel_ratio=ratio, track=0.33), Twist(linear, 0.0), 3.0)
    difference = linear * (math.sqrt(ratio) - 1.0 / math.sqrt(ratio))
    assert robot.twist.angular == pytest.approx(difference / 0.33)


def test_slip_shortens_the_way_but_not_the_odometry() -> None:
    firm = driven(base(), Twist(0.3, 0.0), 5.0)
    slipping = driven(base(slip=0.2), Twist(0.3, 0.0), 5.0)
    assert slipping.pose.x == pytest.approx(0.8 * firm.pose.x)
    assert slipping.odometry.x == pytest.approx(firm.odometry.x)


@pytest.mark.parametrize('delay', [0.0, 0.09, 0.5])
def test_a_command_reaches_the_motors_after_the_delay(delay: float) -> None:
    robot = base(command_delay=delay)
    robot.command(Command(Twist(0.3, 0.0)))
    robot.advance(ns(delay))
    assert robot.pose == START
    robot.advance(ns(delay + 2.0 * SUBSTEP))
    assert robot.pose.x > 0.0


def test_delayed_commands_arrive_in_their_order() -> None:
    robot = base(command_delay=0.3)
    for linear in (0.1, 0.2, 0.3):
        driven(robot, Twist(linear, 0.0), 0.05)
    robot.advance(robot.now_ns + ns(5.0))
    assert robot.wanted == Twist(0.3, 0.0)


def test_perfect_wheels_measure_the_true_way() -> None:
    robot = driven(base(), Twist(0.4, 0.3), 6.0)
    assert robot.odometry == robot.pose


def test_the_odometry_drifts_as_much_as_configured() -> None:
    drift = []
    for seed in range(60):
        robot = driven(base(seed=seed, odometry_noise=0.0075), Twist(0.5, 0.0), 10.0)
        drift.append(robot.odometry.x - robot.pose.x)
    way = driven(base(), Twist(0.5, 0.0), 10.0).pose.x
    # A random walk along the way; the deviation of 60 draws is known to 9 %: three of those.
    assert np.std(drift) == pytest.approx(0.0075 * math.sqrt(way), rel=0.3)


def test_the_odometry_of_a_standing_robot_does_not_drift() -> None:
    robot = driven(base(odometry_noise=0.1), STANDSTILL, 10.0)
    assert robot.odometry == START


def test_the_drift_is_fixed_by_the_seed_and_leaves_the_truth_alone() -> None:
    bases = [base(seed=seed, odometry_noise=0.01) for seed in (4, 4, 5)]
    one, same, other = (driven(each, Twist(0.4, 0.2), 3.0) for each in bases)
    assert one.odometry == same.odometry
    assert one.odometry != other.odometry
    assert one.pose == other.pose


@pytest.mark.parametrize(('asked', 'obeyed'), [(0.234, 0.23), (0.004, 0.0), (-0.006, -0.01)])
def test_speeds_come_in_steps(asked: float, obeyed: float) -> None:
    robot = driven(base(step_linear=0.01, step_angular=0.01), Twist(asked, asked), 2.0)
    assert (robot.twist.linear, robot.twist.angular) == pytest.approx((obeyed, obeyed))


def test_a_body_nods_back_as_it_speeds_up_and_rings_at_three_hertz() -> None:
    robot = base(nod=0.02, acceleration=0.5, max_linear=5.0)
    robot.command(Command(Twist(2.5, 0.0)))
    pitches = []
    for _ in range(300):
        robot.advance(robot.now_ns + ns(SUBSTEP))
        pitches.append(robot.nodding.pitch)
    rest = -0.02 / (1.0 + OVERSHOOT)
    assert min(pitches) == pytest.approx(-0.02, rel=0.01)
    crossings = np.flatnonzero(np.diff(np.sign(np.array(pitches[:120]) - rest)))
    assert np.diff(crossings).mean() * SUBSTEP == pytest.approx(1.0 / 6.0, rel=0.03)
    assert pitches[-1] == pytest.approx(rest, rel=0.05)


@pytest.mark.parametrize('share', [0.0, 0.3, 1.0])
def test_between_two_times_a_nod_is_smooth(share: float) -> None:
    start, acceleration = Nod(0.01, -0.1), 0.4
    states = [start]
    for _ in range(40):
        states.append(states[-1].after(acceleration, 0.001, largest=0.02))
    between = start.towards(states[-1], share, 0.04)
    expected = states[round(40 * share)]
    assert between.pitch == pytest.approx(expected.pitch, abs=1e-4)
    assert between.rate == pytest.approx(expected.rate, abs=0.01)


def test_casters_push_the_base_aside_once_after_a_reversal() -> None:
    robot = driven(base(caster_kick=0.02), Twist(-0.2, 0.0), 2.0)
    assert robot.pose.theta == 0.0
    driven(robot, Twist(0.2, 0.0), 4.0)
    assert abs(robot.pose.theta) == pytest.approx(0.02)
    assert abs(driven(robot, Twist(0.3, 0.0), 1.0).pose.theta) == pytest.approx(0.02)
    turns = set()
    for sign in (-1.0, 1.0) * 6:
        before = robot.pose.theta
        driven(robot, Twist(sign * 0.2, 0.0), 4.0)
        turns.add(round(robot.pose.theta - before, 6))
    assert turns == {-0.02, 0.02}


def car(**changes: float) -> Ackermann:
    return Ackermann(AckermannSettings(**(PLAIN | changes)), START, seed=0)


def test_a_turn_without_speed_steers_and_moves_nothing() -> None:
    robot = driven(car(), Twist(0.0, 0.3), 2.0)
    assert robot.pose == START
    assert robot.steering == robot.settings.max_steering


def test_it_drives_no_tighter_circle_than_its_steering_allows() -> None:
    robot = driven(car(), Twist(0.2, 1.5), 5.0)
    tightest = math.tan(robot.settings.max_steering) / robot.settings.wheelbase
    assert robot.twist.angular / robot.twist.linear == pytest.approx(tightest)


def test_its_wheels_take_their_time() -> None:
    robot = driven(car(steering_rate=0.5), Twist(0.2, 0.2), 0.4)
    assert robot.steering == pytest.approx(0.2)
