"""Comparison of a replay with its recording: differences by quantity, and the first one."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
import math
from typing import Any

from visual_servo_epipolar.bags.reading.run import RecordedTwist, Recording
from visual_servo_epipolar.bags.replaying.replay import ReplayedStep
from visual_servo_epipolar.core.laws.phase import Phase
from visual_servo_epipolar.core.stamps import seconds_between

COMMANDS = ('linear_m_s', 'angular_rad_s')
Value = float | str


@dataclass(slots=True)
class Difference:
    """Difference of one quantity over a run: in how many steps, at most, and root mean square."""

    compared: int = 0
    differing: int = 0
    largest: float = 0.0
    root: float = 0.0  # of the sum of squares

    @property
    def rms(self) -> float:
        """Root mean square of the difference."""
        return self.root / math.sqrt(self.compared) if self.compared else 0.0


@dataclass(frozen=True, slots=True)
class Divergence:
    """Divergence: the first step that differs, recorded and replayed value by quantity."""

    stamp_ns: int
    time_s: float
    values: Mapping[str, tuple[Value, Value]]


@dataclass(slots=True)
class Comparison:
    """
    Comparison of all steps of a replay with the recording.

    ``compared`` counts the steps of which something was recorded, ``missing`` recorded steps that
    could not be replayed; ``unpublished`` counts replayed commands that are not on the topic of
    the commands, None where that is not recorded or unknown.
    """

    tolerance: float
    compared: int = 0
    missing: int = 0
    unpublished: int | None = None
    divergence: Divergence | None = None
    differences: dict[str, Difference] = field(default_factory=dict)

    @property
    def equal(self) -> bool:
        """Whether nothing differs beyond the tolerance, and nothing is missing."""
        return self.divergence is None and not self.missing and not self.unpublished


def recorded_steps(run: Recording, steps: Sequence[ReplayedStep]) -> list[dict[str, Value]]:
    """Return the recorded values of each of ``steps``: all telemetry, or the command alone."""
    if run.telemetry:
        return [_telemetry(run, item) for item in steps]
    return _commands(run.commands, steps)


def compare(run: Recording, steps: Sequence[ReplayedStep], tolerance: float) -> Comparison:
    """
    Compare each replayed step with the recorded one.

    ``tolerance`` is in the unit of each quantity, and relative where that is larger than one:
    |a - b| <= tolerance max(1, |a|). With 0 all must be equal to the last bit. Phases must always
    be equal.
    """
    result = Comparison(tolerance)
    for step, recorded in zip(steps, recorded_steps(run, steps), strict=True):
        replayed: dict[str, Value] = {'phase': step.phase.value, **step.telemetry}
        pairs = {
            name: (value, replayed[name]) for name, value in recorded.items() if name in replayed
        }
        result.compared += bool(pairs)
        differing = {
            name: pair for name, pair in pairs.items() if _add_pair(result, name, pair, tolerance)
        }
        if differing and result.divergence is None:
            time_s = seconds_between(steps[0].key[0], step.key[0])
            result.divergence = Divergence(step.key[0], time_s, differing)
    result.missing = len(run.telemetry.keys() - {item.key for item in steps})
    if tolerance == 0.0 and run.telemetry and run.commands:
        result.unpublished = _count_unpublished(run.commands, steps)
    return result


def _telemetry(run: Recording, step: ReplayedStep) -> dict[str, Value]:
    diagnosis = run.diagnoses.get(step.key[0], {})
    phase = {'phase': diagnosis['phase']} if 'phase' in diagnosis else {}
    return {**phase, **run.telemetry.get(step.key, {})}


def _commands(
    commands: Sequence[RecordedTwist], steps: Sequence[ReplayedStep]
) -> list[dict[str, Value]]:
    """Return the recorded command of each step: that of its stamp, or the next without one."""
    by_stamp = {item.stamp_ns: item for item in commands if item.stamp_ns is not None}
    pending = [item for item in commands if item.stamp_ns is None]
    answers: list[dict[str, Value]] = []
    for number, step in enumerate(steps):
        end_ns = steps[number + 1].log_ns if number + 1 < len(steps) else math.inf
        while pending and pending[0].log_ns < step.log_ns:
            pending = pending[1:]
        answer = by_stamp.get(step.key[0])
        if answer is None and pending and pending[0].log_ns < end_ns:
            answer = pending[0]
        twist = None if answer is None else answer.twist
        answers.append(
            {}
            if twist is None
            else dict(zip(COMMANDS, (twist.linear, twist.angular), strict=True))
        )
    return answers


def _add_pair(result: Comparison, name: str, pair: tuple[Value, Value], tolerance: float) -> bool:
    """Take one pair into the statistics, and return whether it differs."""
    total = result.differences.setdefault(name, Difference())
    difference = _distance(*pair)
    total.compared += 1
    if math.isfinite(difference):
        total.largest = max(total.largest, difference)
        total.root = math.hypot(total.root, difference)  # a broken bag may hold 1e200
    recorded = pair[0]
    scale = 1.0
    if isinstance(recorded, float) and math.isfinite(recorded):
        scale = max(1.0, abs(recorded))
    differing = difference > tolerance * scale
    total.differing += differing
    return differing


def _distance(recorded: Value, replayed: Value) -> float:
    if isinstance(recorded, str) or isinstance(replayed, str):
        return 0.0 if recorded == replayed else math.inf
    if recorded == replayed or (math.isnan(recorded) and math.isnan(replayed)):
        return 0.0
    distance = abs(recorded - replayed)
    return math.inf if math.isnan(distance) else distance


def _count_unpublished(commands: Sequence[RecordedTwist], steps: Sequence[ReplayedStep]) -> int:
    """Count replayed commands that are missing, in their order, among the published ones."""
    expected = [
        (step.telemetry['linear_m_s'], step.telemetry['angular_rad_s'])
        for before, step in zip([None, *steps], steps, strict=False)
        if _is_commanded(before, step)
    ]
    position = 0
    for twist in (item.twist for item in commands):
        if position < len(expected) and (twist.linear, twist.angular) == expected[position]:
            position += 1
    return len(expected) - position


def _is_commanded(before: ReplayedStep | None, step: ReplayedStep) -> bool:
    """Return whether the servo certainly commands a step: one of a run, or its end."""
    if step.phase.ended:
        return before is not None and not before.phase.ended
    return step.phase is not Phase.WAITING


def as_document(result: Comparison) -> dict[str, Any]:
    """Return the comparison as the JSON document of the command line."""
    divergence = result.divergence
    return {
        'equal': result.equal,
        'tolerance': result.tolerance,
        'compared_steps': result.compared,
        'missing_steps': result.missing,
        'unheard_commands': result.unpublished,
        'parting': None
        if divergence is None
        else {
            'stamp_ns': divergence.stamp_ns,
            'time_s': divergence.time_s,
            'quantities': {
                name: {'recorded': recorded, 'replayed': replayed}
                for name, (recorded, replayed) in divergence.values.items()
            },
        },
        'differences': {
            name: {'apart': item.differing, 'largest': item.largest, 'rms': item.rms}
            for name, item in result.differences.items()
        },
    }
