"""
Record of a run with a fault, and the judge: the verdict by ground truth.

The record holds the robot's poses, and inputs, commands and reports of the servo.
"""

from collections.abc import Callable, Mapping
from dataclasses import asdict, dataclass, field
from enum import Enum
import math
from typing import Any, NamedTuple

from visual_servo_epipolar.core.geometry.motion import (
    DESIRED_POSE,
    Pose,
    STANDSTILL,
    Twist,
    wrap_angle,
)
from visual_servo_epipolar.core.laws.phase import Phase
from visual_servo_epipolar.simulation.bases import PioneerSettings


class TrueMotion(NamedTuple):
    """Where the robot really is, and how it moves, at ``time_s``."""

    time_s: float
    pose: Pose
    twist: Twist


class ServoCommand(NamedTuple):
    """A command of the servo at ``time_s``, and the largest ``most`` that it was given by then."""

    time_s: float
    twist: Twist
    most: Twist


class SeenTracks(NamedTuple):
    """What reached the servo at ``time_s``: tracks of the true scene as it was at ``taken_s``."""

    time_s: float
    taken_s: float


@dataclass(slots=True)
class Record:
    """
    Record of one run; times are of the steady clock [s].

    ``goals`` are the poses that were asked for, ``moved_s`` when the robot was carried,
    ``stopped_s`` when it was commanded to stand for good, ``arrived_s``
    when it last reported its arrival, ``why`` the words of nodes that reported why it stands,
    ``senseless`` what was wrong with a command that is no velocity.
    """

    truths: list[TrueMotion] = field(default_factory=list)
    orders: list[ServoCommand] = field(default_factory=list)
    seen: list[SeenTracks] = field(default_factory=list)
    goals: list[Pose] = field(default_factory=lambda: [DESIRED_POSE])
    moved_s: list[float] = field(default_factory=list)
    stopped_s: float = math.inf
    arrived_s: float = math.inf
    phase: str = 'waiting'
    reason: str = ''
    why: list[str] = field(default_factory=list)
    crashes: list[str] = field(default_factory=list)
    senseless: str = ''


@dataclass(frozen=True, kw_only=True)
class SafetyBounds:
    """
    What is right and what is allowed.

    ``sight_s``: how old the newest true sight may be before a moving robot must begin to stand;
    ``period_s``: between two images.
    """

    sight_s: float
    period_s: float
    base: PioneerSettings = PioneerSettings()
    position_m: float = 0.03
    heading_rad: float = math.radians(1.0)
    excursion_ratio: float = 2.0
    excursion_m: float = 1.0


class RunVerdict(str, Enum):
    """Verdict on a run: two are safe."""

    ARRIVED = 'arrived'
    AT_REST = 'at rest'
    UNJUDGED = 'not judged'  # what failed is the campaign itself
    TRACEBACK = 'traceback'
    BLIND = 'moved without sight'
    DISOBEYED = 'moved after stop'
    LIMITS = 'limits exceeded'
    RAN_AWAY = 'ran away'
    STILL_MOVING = 'still moving at the end'
    WRONG_ARRIVAL = 'wrong arrival'
    UNEXPLAINED = 'at rest without a reason'


SAFE = (RunVerdict.ARRIVED, RunVerdict.AT_REST)


MOVING = 1e-3  # [m/s, rad/s]
ROUNDING = 1e-6  # by which a limit may be exceeded


def moving(twist: Twist) -> bool:
    """Return whether a base of this velocity moves."""
    return max(abs(twist.linear), abs(twist.angular)) > MOVING


def braking_s(twist: Twist, bounds: SafetyBounds) -> float:
    """Return the time in which the base comes to rest from ``twist`` [s]."""
    return bounds.base.command_delay + max(
        abs(twist.linear) / bounds.base.deceleration,
        abs(twist.angular) / bounds.base.angular_acceleration,
    )


def speed(twist: Twist) -> str:
    """Return a velocity in words."""
    return f'{twist.linear:.2f} m/s, {twist.angular:.2f} rad/s'


@dataclass(frozen=True, slots=True)
class Judgement:
    """
    RunVerdict on a run, and why; with the excursion [m], the time moved without sight [s].

    ``charges`` are all violations found: the verdict is the first of them.
    """

    verdict: RunVerdict
    detail: str
    excursion_m: float = math.nan
    blind_s: float = math.nan
    position_error_m: float = math.nan
    charges: tuple[str, ...] = ()

    @property
    def safe(self) -> bool:
        """Whether the robot arrived right, or stands and says why."""
        return self.verdict in SAFE

    def document(self, record: Record, **facts: Any) -> dict[str, Any]:
        """Return the JSON object of a run: ``facts`` about it, the verdict, its reports."""
        end = {'verdict': self.verdict.value, 'phase': record.phase, 'reason': record.reason}
        return {**facts, 'safe': self.safe, **asdict(self), **end}


def judge_run(record: Record, bounds: SafetyBounds) -> Judgement:
    """Return the verdict on a run: its worst violation, or that it is safe."""
    found = {verdict: violation(record, bounds) for verdict, violation in INVARIANTS.items()}
    charges = [(verdict, text) for verdict, text in found.items() if text]
    harmless = RunVerdict.AT_REST, record.why[-1] if record.why else ''
    if record.phase == Phase.ARRIVED.value:
        harmless = RunVerdict.ARRIVED, record.reason
    verdict, detail = charges[0] if charges else harmless
    return Judgement(
        verdict,
        detail,
        excursion_m=max((it.pose.distance for it in record.truths), default=0.0),
        blind_s=_blindness(record, bounds)[0],
        position_error_m=min(_off(record, goal)[0] for goal in record.goals),
        charges=tuple(f'{name.value}: {text}' for name, text in charges),
    )


def _traceback(record: Record, bounds: SafetyBounds) -> str:
    return ' '.join(record.crashes[0].split())[-300:] if record.crashes else ''


def _blindness(record: Record, bounds: SafetyBounds) -> tuple[float, str]:
    """
    Return how long the robot moved without sight [s], and the charge if it was too long.

    The newest true sight grows old from when its image was taken: a late image is an old one.
    Beyond ``sight_s`` the robot must brake, and what it needs for that is no offence.
    """
    seen, number, total_s, charge, at_onset = sorted(record.seen), 0, 0.0, '', STANDSTILL
    newest_s = before_s = record.truths[0].time_s if record.truths else math.nan
    for time_s, _, twist in record.truths:
        while number < len(seen) and seen[number].time_s <= time_s:
            newest_s = max(newest_s, seen[number].taken_s)
            number += 1
        onset_s = newest_s + bounds.sight_s
        if time_s <= onset_s:
            at_onset = twist
        elif moving(twist):
            total_s += time_s - before_s
            if time_s > onset_s + braking_s(at_onset, bounds) and not charge:
                charge = f'{speed(twist)}, the last true sight {time_s - newest_s:.1f} s old'
        before_s = time_s
    return total_s, charge


def _disobedience(record: Record, bounds: SafetyBounds) -> str:
    """Return how the robot moved after it was commanded to stand."""
    at_stop, stopped_s = STANDSTILL, record.stopped_s
    for truth in record.truths:
        at_stop = truth.twist if truth.time_s <= stopped_s else at_stop
        limit_s = stopped_s + bounds.period_s + braking_s(at_stop, bounds)
        if truth.time_s > limit_s and moving(truth.twist):
            return f'{speed(truth.twist)} {truth.time_s - stopped_s:.1f} s after the stop'
    return ''


def _excess(record: Record, bounds: SafetyBounds) -> str:
    """Return which command of the servo was beyond its limits, or no velocity at all."""
    for _, twist, most in record.orders:
        over = abs(twist.linear) - most.linear, abs(twist.angular) - most.angular
        if max(over) > ROUNDING:
            return f'the servo commands {speed(twist)} where {speed(most)} are allowed'
    return record.senseless


def _excursion(record: Record, bounds: SafetyBounds) -> str:
    if not record.truths:
        return ''
    begin = record.truths[0].pose.distance
    limit = bounds.excursion_ratio * begin + bounds.excursion_m
    farthest = max(it.pose.distance for it in record.truths)
    return f'{farthest:.1f} m from the goal, from {begin:.1f} m' if farthest > limit else ''


def _moves_at_the_end(record: Record) -> bool:
    return bool(record.truths) and moving(record.truths[-1].twist)


def _motion_at_the_end(record: Record, bounds: SafetyBounds) -> str:
    moves = _moves_at_the_end(record)
    return f'{speed(record.truths[-1].twist)} in {record.phase}' if moves else ''


def _arrival_error(record: Record, bounds: SafetyBounds) -> str:
    """Return how far from each goal a robot stands that reports its arrival."""
    if record.phase != Phase.ARRIVED.value or _moves_at_the_end(record):
        return ''
    offs = [_off(record, goal) for goal in record.goals]
    if any(off <= bounds.position_m and turn <= bounds.heading_rad for off, turn in offs):
        return ''
    off, turn = min(offs)
    return f'{1e3 * off:.0f} mm, {math.degrees(turn):.1f} deg from the goal'


def _silence(record: Record, bounds: SafetyBounds) -> str:
    if record.why or record.phase == Phase.ARRIVED.value or _moves_at_the_end(record):
        return ''
    return f'stands in {record.phase}, and no node says why'


# What must hold in every run, the worst first: each returns how it was violated, or ''.
INVARIANTS: Mapping[RunVerdict, Callable[[Record, SafetyBounds], str]] = {
    RunVerdict.TRACEBACK: _traceback,
    RunVerdict.BLIND: lambda record, bounds: _blindness(record, bounds)[1],
    RunVerdict.DISOBEYED: _disobedience,
    RunVerdict.LIMITS: _excess,
    RunVerdict.RAN_AWAY: _excursion,
    RunVerdict.STILL_MOVING: _motion_at_the_end,
    RunVerdict.WRONG_ARRIVAL: _arrival_error,
    RunVerdict.UNEXPLAINED: _silence,
}


def _off(record: Record, goal: Pose) -> tuple[float, float]:
    """Return how far [m] and how turned [rad] from ``goal`` the robot is at the end."""
    if not record.truths:
        return math.nan, math.nan
    away_s = math.inf
    if record.phase == Phase.ARRIVED.value:  # one that is carried away afterwards had arrived
        carried = [it for it in record.moved_s if it > record.arrived_s]
        away_s = min(carried, default=math.inf)
    there = [truth for truth in record.truths if truth.time_s < away_s] or record.truths
    pose = there[-1].pose
    off = math.hypot(pose.x - goal.x, pose.y - goal.y)
    return off, abs(wrap_angle(pose.theta - goal.theta))
