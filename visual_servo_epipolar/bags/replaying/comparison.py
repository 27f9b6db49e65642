"""Recorded against replayed: what is the same, what is not, and where they part first."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
import math
from typing import Any

from visual_servo_epipolar.bags.reading.run import Command, Recording
from visual_servo_epipolar.bags.replaying.replay import Step
from visual_servo_epipolar.core.stamps import seconds_between

COMMANDS = ('linear_m_s', 'angular_rad_s')
Value = float | str


@dataclass(slots=True)
class Difference:
    """How one quantity differs over a run: in how many steps, at most, and root mean square."""

    compared: int = 0
    apart: int = 0
    largest: float = 0.0
    squares: float = 0.0

    @property
    def rms(self) -> float:
        """Root mean square of the difference."""
        return math.sqrt(self.squares / self.compared) if self.compared else 0.0


@dataclass(frozen=True, slots=True)
class Parting:
    """The first step in which anything differs: recorded and replayed value by quantity."""

    stamp_ns: int
    time_s: float
    values: Mapping[str, tuple[Value, Value]]


@dataclass(slots=True)
class Comparison:
    """
    What a replay is worth.

    ``compared`` counts the steps of which something was recorded, ``missing`` recorded steps that
    could not be replayed; ``unheard`` counts replayed commands that are not on the topic of the
    commands, None where that is not recorded or cannot be told.
    """

    tolerance: float
    compared: int = 0
    missing: int = 0
    unheard: int | None = None
    parting: Parting | None = None
    differences: dict[str, Difference] = field(default_factory=dict)

    @property
    def equal(self) -> bool:
        """Whether nothing differs beyond the tolerance, and nothing is missing."""
        return self.parting is None and not self.missing and not self.unheard


def recorded_steps(run: Recording, steps: Sequence[Step]) -> list[dict[str, Value]]:
    """Return what was recorded of each of ``steps``: all telemetry, or the command alone."""
    if run.numbers:
        return [_telemetry(run, item) for item in steps]
    return _commands(run.commands, steps)


def compare(run: Recording, steps: Sequence[Step], tolerance: float) -> Comparison:
    """
    Compare each replayed step with the recorded one.

    ``tolerance`` is in the unit of each quantity, and relative where that is larger than one:
    |a - b| <= tolerance max(1, |a|). With 0 all must be the same to the last bit. Phases must
    always be the same.
    """
    result = Comparison(tolerance)
    for done, before in zip(steps, recorded_steps(run, steps), strict=True):
        now: dict[str, Value] = {'phase': done.phase.value, **done.numbers}
        pairs = {name: (value, now[name]) for name, value in before.items() if name in now}
        result.compared += bool(pairs)
        apart = {
            name: pair for name, pair in pairs.items() if _counted(result, name, pair, tolerance)
        }
        if apart and result.parting is None:
            time_s = seconds_between(steps[0].key[0], done.key[0])
            result.parting = Parting(done.key[0], time_s, apart)
    result.missing = len(run.numbers.keys() - {item.key for item in steps})
    if tolerance == 0.0 and run.numbers and run.commands:
        result.unheard = _unheard(run.commands, steps)
    return result


def _telemetry(run: Recording, step: Step) -> dict[str, Value]:
    said = run.diagnoses.get(step.key[0], {})
    phase = {'phase': said['phase']} if 'phase' in said else {}
    return {**phase, **run.numbers.get(step.key, {})}


def _commands(commands: Sequence[Command], steps: Sequence[Step]) -> list[dict[str, Value]]:
    """Return the command that each step was answered with: by its stamp, or the next one."""
    by_stamp = {item.stamp_ns: item for item in commands if item.stamp_ns is not None}
    waiting = [item for item in commands if item.stamp_ns is None]
    found: list[dict[str, Value]] = []
    for number, done in enumerate(steps):
        end_ns = steps[number + 1].log_ns if number + 1 < len(steps) else math.inf
        while waiting and waiting[0].log_ns < done.log_ns:
            waiting = waiting[1:]
        answer = by_stamp.get(done.key[0])
        if answer is None and waiting and waiting[0].log_ns < end_ns:
            answer = waiting[0]
        found.append({} if answer is None else _values(answer))
    return found


def _values(command: Command) -> dict[str, Value]:
    return dict(zip(COMMANDS, (command.twist.linear, command.twist.angular), strict=True))


def _counted(result: Comparison, name: str, pair: tuple[Value, Value], tolerance: float) -> bool:
    """Take one pair into the statistics, and return whether it is apart."""
    total = result.differences.setdefault(name, Difference())
    size = _distance(*pair)
    total.compared += 1
    if math.isfinite(size):
        total.largest, total.squares = max(total.largest, size), total.squares + size**2
    before = pair[0]
    scale = max(1.0, abs(before)) if isinstance(before, float) and math.isfinite(before) else 1.0
    apart = size > tolerance * scale
    total.apart += apart
    return apart


def _distance(before: Value, now: Value) -> float:
    if isinstance(before, str) or isinstance(now, str):
        return 0.0 if before == now else math.inf
    if before == now or (math.isnan(before) and math.isnan(now)):
        return 0.0
    distance = abs(before - now)
    return math.inf if math.isnan(distance) else distance


def _unheard(commands: Sequence[Command], steps: Sequence[Step]) -> int:
    """Count replayed commands that were not published, in their order among what was."""
    wanted, place = [(s.numbers['linear_m_s'], s.numbers['angular_rad_s']) for s in steps], 0
    for command in commands:
        if place < len(wanted) and (command.twist.linear, command.twist.angular) == wanted[place]:
            place += 1
    return len(wanted) - place


def as_document(result: Comparison) -> dict[str, Any]:
    """Return the comparison as the JSON document of the command line."""
    parting = result.parting
    return {
        'equal': result.equal,
        'tolerance': result.tolerance,
        'compared_steps': result.compared,
        'missing_steps': result.missing,
        'unheard_commands': result.unheard,
        'parting': None
        if parting is None
        else {
            'stamp_ns': parting.stamp_ns,
            'time_s': parting.time_s,
            'quantities': {
                name: {'recorded': before, 'replayed': now}
                for name, (before, now) in parting.values.items()
            },
        },
        'differences': {
            name: {'apart': item.apart, 'largest': item.largest, 'rms': item.rms}
            for name, item in result.differences.items()
        },
    }
