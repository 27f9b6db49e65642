"""
A law and its state machine: one row for each of its phases, and the events that lead between them.

A row holds what a step asks of a phase, as functions of goal, memory and settings. Every
machine loses its tracks and fails in the same way, whatever phases a law brings.
"""

from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass, replace
from types import MappingProxyType
from typing import Any, ClassVar, TypeAlias

from visual_servo_epipolar.core.estimate.goal_estimate import GoalEstimate
from visual_servo_epipolar.core.estimate.settings import Departures, DriveSettings
from visual_servo_epipolar.core.geometry.motion import STANDSTILL, Twist
from visual_servo_epipolar.core.laws.memory import Memory
from visual_servo_epipolar.core.laws.phase import Event, Phase

Classifier: TypeAlias = Callable[[GoalEstimate, Memory, DriveSettings], Event]
Command: TypeAlias = Callable[[GoalEstimate, Memory, DriveSettings], Twist]
Predicate: TypeAlias = Callable[[GoalEstimate, Memory, DriveSettings], bool]
Update: TypeAlias = Callable[[GoalEstimate, Memory, DriveSettings], Memory]


@dataclass(frozen=True, kw_only=True)
class PhaseRow:
    """
    Row of a phase: what a law does in it, and how people read it.

    ``words``: what the robot does in it, a verb first; ``colour``: '#RRGGBB' in figures.
    ``classify`` returns the event of an image, ``command`` the nominal twist, before limits, ramps
    and dead band. ``is_settled``: whether an image fulfils the aim of the phase; ``settling``
    counts such images in a row. ``is_close``: whether it is within the usual tolerance, where a
    memory of views asks for less. ``begin`` changes the memory when the phase begins, and raises
    ValueError where it cannot: the event is then NO_GAIN. ``observe`` changes it at each image.
    """

    phase: Phase
    words: str
    colour: str
    classify: Classifier = lambda *_: Event.NOTHING  # that only an interruption ends
    command: Command = lambda *_: STANDSTILL
    is_settled: Predicate = lambda *_: False
    is_close: Predicate = lambda *_: False
    begin: Update = lambda _, memory, __: memory
    observe: Update = lambda _, memory, __: memory


class StateMachine:
    """
    State machine of a law: ``rows`` by phase, and the ``transitions`` between them.

    ``row_of_word`` has the rows of all machines by word, that of the first where several share it.
    """

    row_of_word: ClassVar[dict[str, PhaseRow]] = {}

    def __init__(
        self, rows: Iterable[PhaseRow], transitions: Mapping[tuple[Phase, Event], Phase]
    ) -> None:
        self.rows: Mapping[Phase, PhaseRow] = MappingProxyType({row.phase: row for row in rows})
        self.transitions = MappingProxyType(dict(transitions))
        required = {Phase.WAITING, Phase.HOLDING, Phase.ARRIVED, Phase.FAILED}
        named = required | {phase for phase, _ in transitions} | {*transitions.values()}
        missing = [phase.value for phase in named if phase not in self.rows]
        if missing:
            raise ValueError(
                f'there is no row for {", ".join(sorted(missing))}, to or from which transitions '
                'lead; add a PhaseRow for each to the machine of the law'
            )
        for phase, row in self.rows.items():
            self.row_of_word.setdefault(phase.value, row)

    def row(self, phase: Phase) -> PhaseRow:
        """Return the row of ``phase``; for one of another law, one that loses it: it will hold."""
        unknown = PhaseRow(phase=phase, words='', colour='', classify=lambda *_: Event.LOST)
        return self.rows.get(phase) or unknown

    @property
    def first_phases(self) -> set[Phase]:
        """Phases in which a servo may be after its first image."""
        after = {phase for (before, _), phase in self.transitions.items() if not before.runs}
        return {Phase.WAITING, Phase.HOLDING} | after

    def next_phase(self, phase: Phase, event: Event) -> Phase:
        """Return the phase that follows ``event``; a pair not in the table keeps the phase."""
        return interruption(phase, event) or self.transitions.get((phase, event), phase)


def interruption(phase: Phase, event: Event) -> Phase | None:
    """Return the phase after an ``event`` that interrupts or ends any run; None for others."""
    if event is Event.LOST and (phase.drives or phase is Phase.WAITING):
        return Phase.HOLDING
    return Phase.FAILED if event.fails and phase.runs else None


@dataclass(frozen=True, slots=True, kw_only=True)
class Law(Departures):
    """
    Law of the servo: its departures from the paper, its controls and its phases.

    ``machine`` has phases other than the paper's two steps and what goes with them, None is that
    of the paper. ``on_arcs`` is the machine on a base that does not turn in place; None of a law
    that has to.
    """

    machine: StateMachine | None = None
    on_arcs: StateMachine | None = None

    def changed(self, departures: Mapping[str, bool]) -> 'Law':
        """Return this law with some departures taken (True) or left out (False)."""
        changes: dict[str, Any] = dict(departures)
        return replace(self, **changes)
