"""Records of runs that never were, for the judge."""

from collections.abc import Sequence
import math

from visual_servo_epipolar.core.geometry.motion import integrate, Pose, STANDSTILL, Twist
from visual_servo_epipolar.evaluation.faults.judge import (
    Limits,
    Record,
    SafetyBounds,
    SeenTracks,
    ServoCommand,
    TrueMotion,
)

LIMITS = Limits(0.4, 0.5, 0.25, 1.2)
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
    made.sight.seen = [SeenTracks(it + latency_s, it) for it in taken if it <= sight_until_s]
    made.orders = [ServoCommand(0.1 * k, STANDSTILL, LIMITS) for k in range(3)]
    return made


def ramp(speed: float) -> list[tuple[float, float]]:
    """Return speeds on the way to ``speed``, which no base takes at once."""
    steps = round(speed / 0.01)
    return [(0.01 * number, TICK_S) for number in range(steps + 1)]


def drive(speed: float, seconds: float) -> list[tuple[float, float]]:
    """Return speeds of a robot that drives at ``speed`` for so long, and stands again."""
    return [*ramp(speed), (speed, seconds), *reversed(ramp(speed)), (0.0, 1.0)]
