"""The judge condemns each offence, and nothing else: on records that are made for it."""

from collections.abc import Sequence
import math
from typing import Any

import pytest

from visual_servo_epipolar.core.geometry.motion import integrate, Pose, STANDSTILL, Twist
from visual_servo_epipolar.evaluation.faults.judge import (
    judge_run,
    Record,
    RunVerdict,
    SAFE,
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


def but(made: Record, **changes: Any) -> Record:
    """Return ``made`` with other values; those of which it keeps several are added to them."""
    for name, value in changes.items():
        before = getattr(made, name)
        setattr(made, name, [*before, *value] if isinstance(before, list) else value)
    return made


WAY = drive(0.3, 3.0)
ASIDE, TURNED = Pose(0.1, -1.08, math.pi / 2), Pose(0.0, -1.08, math.pi / 2 + 0.02)
AWAY = Pose(0, -3, 1.5)
ORDER = ServoCommand(1.0, Twist(0.01, 0.0), LIMITS)
BRAKE = [(0.3 - 0.012 * k, 0.02) for k in range(25)]  # half a second, at 0.6 m/s^2


def carried_away(arrived_s: float) -> Record:
    """Return a run that is carried away after its end; ``arrived_s`` is counted from there."""
    made = record([*WAY, (0.0, 1.0)])
    end = made.truths[-1]
    away = TrueMotion(end.time_s + 0.1, Pose(0.5, -1.0, math.pi / 2), end.twist)
    moved_s = [end.time_s + 0.05]
    return but(made, truths=[away], moved_s=moved_s, arrived_s=end.time_s + arrived_s)


def moving_at_the_end() -> Record:
    made = record(WAY, phase='displacing')
    last = made.truths[-1]
    return but(made, truths=[TrueMotion(last.time_s + 0.02, last.pose, Twist(0.0, 0.02))])


@pytest.mark.parametrize(
    ('made', 'expected'),
    [
        (record(drive(0.3, 1.0), phase='failed', start=AWAY), RunVerdict.AT_REST),
        # Braking after images end is no offence.
        (
            record([*ramp(0.3), (0.3, 1.38), *BRAKE, (0.0, 2.0)], sight_until_s=1.3),
            RunVerdict.ARRIVED,
        ),
        (
            record([*ramp(0.3), (0.3, 1.78), *BRAKE, (0.0, 2.0)], sight_until_s=1.3),
            RunVerdict.BLIND,
        ),
        # Images that come at full rate but late are no sight; nor what is seen before it arrives.
        (record(drive(0.3, 6.0), latency_s=2.5), RunVerdict.BLIND),
        (record(drive(0.3, 6.0), latency_s=0.5), RunVerdict.ARRIVED),
        (
            but(record(drive(0.3, 6.0), sight_until_s=1.0), seen=[SeenTracks(6.5, 6.0)]),
            RunVerdict.BLIND,
        ),
        # An arrival is right at a goal that was asked for.
        (record(WAY, start=ASIDE), RunVerdict.WRONG_ARRIVAL),
        (record(WAY, start=TURNED), RunVerdict.WRONG_ARRIVAL),
        (
            but(record(WAY, start=ASIDE), goals=[record(WAY, start=ASIDE).truths[-1].pose]),
            RunVerdict.ARRIVED,
        ),
        (carried_away(-0.5), RunVerdict.ARRIVED),
        (carried_away(0.1), RunVerdict.WRONG_ARRIVAL),  # it reports it where it was carried to
        # Commands keep to the limits that hold.
        *(
            (but(record(WAY), orders=[ServoCommand(1.0, twist, LIMITS)]), RunVerdict.LIMITS)
            for twist in (Twist(0.41, 0), Twist(-0.41, 0), Twist(0, 0.51), Twist(0, -0.51))
        ),
        (but(record(WAY), senseless='a twist must be finite'), RunVerdict.LIMITS),
        (but(record(WAY), orders=[ORDER]), RunVerdict.ARRIVED),
        (
            but(record(WAY), orders=[ORDER, ServoCommand(1.0, ORDER.twist, Twist(0.005, 0.5))]),
            RunVerdict.LIMITS,
        ),
        # It ran away, though it comes back; it moves at the end, or after it was stopped.
        (
            record([*((-v, seconds) for v, seconds in drive(0.4, 10.0)), *drive(0.4, 10.0)]),
            RunVerdict.RAN_AWAY,
        ),
        (moving_at_the_end(), RunVerdict.STILL_MOVING),
        (but(record(WAY), stopped_s=3.6), RunVerdict.ARRIVED),  # it brakes just then
        (but(record(WAY), stopped_s=1.5), RunVerdict.DISOBEYED),
    ],
)
def test_each_offence_is_condemned_and_nothing_else(made: Record, expected: RunVerdict) -> None:
    judgement = judge_run(made, BOUNDS)
    assert judgement.verdict is expected, judgement.charges
    assert judgement.safe is (expected in SAFE)


def test_a_robot_that_stands_without_a_reason_is_not_safe() -> None:
    made = record(drive(0.3, 1.0), phase='displacing', start=AWAY)
    assert judge_run(made, BOUNDS).detail == 'a reason'
    made.why.clear()
    assert judge_run(made, BOUNDS).verdict is RunVerdict.UNEXPLAINED


def test_a_traceback_is_worse_than_all_else() -> None:
    made = record(drive(0.3, 4.0), sight_until_s=1.5)
    made.crashes.append('servo_node: Traceback ... KeyError')
    judgement = judge_run(made, BOUNDS)
    assert judgement.verdict is RunVerdict.TRACEBACK
    assert [charge.partition(':')[0] for charge in judgement.charges] == [
        'traceback',
        'moved without sight',
    ]


def test_a_base_that_was_never_there_has_done_no_harm() -> None:
    nothing = record(ramp(0.1), phase='waiting')
    nothing.truths.clear()
    judgement = judge_run(nothing, BOUNDS)
    assert (judgement.verdict, judgement.excursion_m) == (RunVerdict.AT_REST, 0.0)
    nothing.why.clear()
    assert judge_run(nothing, BOUNDS).verdict is RunVerdict.UNEXPLAINED
