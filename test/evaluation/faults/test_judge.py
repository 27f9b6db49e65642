"""The judge condemns each offence, and nothing else: on records that are made for it."""

from collections.abc import Sequence
import math

import pytest

from visual_servo_epipolar.core.geometry.motion import integrate, Pose, STANDSTILL, Twist
from visual_servo_epipolar.evaluation.faults.judge import (
    judge_run,
    Record,
    RunVerdict,
    SafetyBounds,
    SeenTracks,
    ServoCommand,
    TrueMotion,
)

LIMITS = Twist(0.4, 0.5)
BOUNDS = SafetyBounds(sight_s=0.75, period_s=0.1)
TICK_S = 0.02


def record(
    speeds: Sequence[tuple[float, float]],
    *,
    sight_until_s: float = math.inf,
    phase: str = 'arrived',
    start: Pose | None = None,
    latency_s: float = 0.05,
) -> Record:
    """
    Return a run that drives at each of ``speeds`` [m/s] for so many seconds.

    Images come ten times a second until ``sight_until_s``, and each is seen ``latency_s`` later.
    It ends at the goal unless a ``start`` is given.
    """
    length = sum(speed * duration for speed, duration in speeds)
    pose = start or Pose(0.0, -length, math.pi / 2)
    made, time_s = Record(phase=phase, why=['a reason']), 0.0
    for speed, duration in speeds:
        for _ in range(round(duration / TICK_S)):
            made.truths.append(TrueMotion(time_s, pose, Twist(speed, 0.0)))
            pose, time_s = integrate(pose, Twist(speed, 0.0), TICK_S), time_s + TICK_S
    made.truths.append(TrueMotion(time_s, pose, STANDSTILL))
    taken = (0.1 * number for number in range(round(10 * time_s) + 1))
    made.seen = [SeenTracks(it + latency_s, it) for it in taken if it <= sight_until_s]
    made.orders = [ServoCommand(0.1 * k, STANDSTILL, LIMITS) for k in range(3)]
    return made


def ramp(speed: float) -> list[tuple[float, float]]:
    """Return speeds on the way to ``speed``, which no base takes at once."""
    steps = round(speed / 0.01)
    return [(0.01 * number, TICK_S) for number in range(steps + 1)]


def drive(speed: float, seconds: float) -> list[tuple[float, float]]:
    """Return speeds of a robot that drives at ``speed`` for so long, and stands again."""
    return [*ramp(speed), (speed, seconds), *reversed(ramp(speed)), (0.0, 1.0)]


def verdict(made: Record) -> RunVerdict:
    return judge_run(made, BOUNDS).verdict


def test_a_robot_that_drives_to_the_goal_and_sees_has_arrived() -> None:
    judgement = judge_run(record(drive(0.3, 3.0)), BOUNDS)
    assert judgement.verdict is RunVerdict.ARRIVED
    assert judgement.safe
    assert judgement.charges == ()
    assert judgement.blind_s == 0.0


def test_a_robot_that_stands_and_says_why_is_at_rest() -> None:
    judgement = judge_run(record(drive(0.3, 1.0), phase='failed', start=Pose(0, -3, 1.5)), BOUNDS)
    assert judgement.verdict is RunVerdict.AT_REST
    assert judgement.detail == 'a reason'


def test_a_robot_that_stands_and_nobody_knows_why_is_not_safe() -> None:
    made = record(drive(0.3, 1.0), phase='displacing', start=Pose(0, -3, 1.5))
    made.why.clear()
    assert verdict(made) is RunVerdict.UNEXPLAINED
    assert not judge_run(made, BOUNDS).safe


def test_a_robot_that_drives_on_when_images_end_is_condemned() -> None:
    made = record(drive(0.3, 4.0), sight_until_s=1.5)
    judgement = judge_run(made, BOUNDS)
    assert judgement.verdict is RunVerdict.BLIND
    assert judgement.blind_s == pytest.approx(4.0 + 2 * 0.6 - 1.5 - BOUNDS.sight_s, abs=0.15)


def test_braking_after_images_end_is_no_offence() -> None:
    """From 0.3 m/s at 0.6 m/s^2 it takes half a second."""
    brake = [(0.3 - 0.012 * k, 0.02) for k in range(25)]
    speeds = [*ramp(0.3), (0.3, 1.38), *brake, (0.0, 2.0)]
    assert verdict(record(speeds, sight_until_s=1.3)) is RunVerdict.ARRIVED
    longer = [*ramp(0.3), (0.3, 1.78), *brake, (0.0, 2.0)]
    assert verdict(record(longer, sight_until_s=1.3)) is RunVerdict.BLIND


def test_images_that_come_at_full_rate_but_late_are_no_sight() -> None:
    assert verdict(record(drive(0.3, 6.0), latency_s=2.5)) is RunVerdict.BLIND
    assert verdict(record(drive(0.3, 6.0), latency_s=0.5)) is RunVerdict.ARRIVED


def test_what_is_seen_before_it_arrives_does_not_count() -> None:
    made = record(drive(0.3, 6.0), sight_until_s=1.0)
    made.seen.append(SeenTracks(6.5, 6.0))
    assert verdict(made) is RunVerdict.BLIND


def test_an_arrival_elsewhere_is_wrong() -> None:
    aside = record(drive(0.3, 3.0), start=Pose(0.1, -1.08, math.pi / 2))
    turned = record(drive(0.3, 3.0), start=Pose(0.0, -1.08, math.pi / 2 + 0.02))
    assert verdict(aside) is RunVerdict.WRONG_ARRIVAL
    assert verdict(turned) is RunVerdict.WRONG_ARRIVAL


def test_an_arrival_at_a_goal_that_somebody_asked_for_is_right() -> None:
    made = record(drive(0.3, 3.0), start=Pose(0.1, -1.08, math.pi / 2))
    made.goals.append(made.truths[-1].pose)
    assert verdict(made) is RunVerdict.ARRIVED


@pytest.mark.parametrize(
    'twist', [Twist(0.41, 0.0), Twist(-0.41, 0.0), Twist(0.0, 0.51), Twist(0.0, -0.51)]
)
def test_a_command_beyond_the_limits_is_condemned(twist: Twist) -> None:
    made = record(drive(0.3, 3.0))
    made.orders.append(ServoCommand(1.0, twist, LIMITS))
    assert verdict(made) is RunVerdict.LIMITS


def test_a_command_that_is_no_velocity_is_condemned() -> None:
    made = record(drive(0.3, 3.0))
    made.senseless = 'a twist must be finite'
    assert verdict(made) is RunVerdict.LIMITS


def test_a_limit_that_was_lowered_counts_from_the_next_command() -> None:
    made, order = record(drive(0.3, 3.0)), ServoCommand(1.0, Twist(0.01, 0.0), LIMITS)
    made.orders.append(order)
    assert verdict(made) is RunVerdict.ARRIVED
    made.orders.append(order._replace(most=Twist(0.005, 0.5)))
    assert verdict(made) is RunVerdict.LIMITS


def test_a_base_that_leaps_is_condemned_unless_it_was_carried() -> None:
    made = record([(0.0, 1.0), (0.3, 1.0), (0.0, 1.0)])
    assert verdict(made) is RunVerdict.LIMITS
    made.moved_s += [1.0, 2.0]
    assert verdict(made) is RunVerdict.ARRIVED


def test_a_robot_that_runs_away_is_condemned_though_it_comes_back() -> None:
    forth = drive(0.4, 10.0)
    back = [(-speed, duration) for speed, duration in forth]
    assert verdict(record([*back, *forth])) is RunVerdict.RAN_AWAY


def test_a_robot_that_moves_at_the_end_is_condemned() -> None:
    made = record(drive(0.3, 3.0), phase='displacing')
    last = made.truths[-1]
    made.truths.append(TrueMotion(last.time_s + 0.02, last.pose, Twist(0.0, 0.02)))
    assert verdict(made) is RunVerdict.STILL_MOVING


def test_a_robot_that_moves_after_it_was_stopped_is_condemned() -> None:
    made = record(drive(0.3, 3.0))
    made.stopped_s = 3.6
    assert verdict(made) is RunVerdict.ARRIVED  # it brakes just then
    made.stopped_s = 1.5
    assert verdict(made) is RunVerdict.DISOBEYED


def test_a_traceback_is_worse_than_all_else() -> None:
    made = record(drive(0.3, 4.0), sight_until_s=1.5)
    made.crashes.append('servo_node: Traceback ... KeyError')
    judgement = judge_run(made, BOUNDS)
    assert judgement.verdict is RunVerdict.TRACEBACK
    assert [charge.partition(':')[0] for charge in judgement.charges] == [
        'traceback',
        'moved without sight',
    ]


def test_who_is_carried_away_after_the_arrival_has_arrived() -> None:
    made = record([*drive(0.3, 3.0), (0.0, 1.0)])
    end = made.truths[-1]
    away = end._replace(time_s=end.time_s + 0.1, pose=Pose(0.5, -1.0, math.pi / 2))
    made.truths.append(away)
    made.arrived_s, made.moved_s = end.time_s - 0.5, [end.time_s + 0.05]
    assert verdict(made) is RunVerdict.ARRIVED
    made.arrived_s = away.time_s  # it says so where it was carried to
    assert verdict(made) is RunVerdict.WRONG_ARRIVAL


def test_wheels_that_slip_may_leap_at_that_moment_alone() -> None:
    made = record([*ramp(0.3), (0.3, 1.0), (0.0, 1.0)], phase='failed')
    leap_s = next(it.time_s for it in made.truths if it.time_s > 1.0 and it.twist == STANDSTILL)
    assert verdict(made) is RunVerdict.LIMITS
    made.moved_s.append(leap_s - 0.01)
    assert verdict(made) is RunVerdict.AT_REST
    made.moved_s[:] = [leap_s - 0.5]
    assert verdict(made) is RunVerdict.LIMITS


def test_a_base_that_was_never_there_has_done_no_harm() -> None:
    nothing = record(ramp(0.1), phase='waiting')
    nothing.truths.clear()
    judgement = judge_run(nothing, BOUNDS)
    assert (judgement.verdict, judgement.excursion_m) == (RunVerdict.AT_REST, 0.0)
    nothing.why.clear()
    assert judge_run(nothing, BOUNDS).verdict is RunVerdict.UNEXPLAINED
