"""Registry of laws, by name; those of other packages join by an entry point."""

from contextlib import suppress

from visual_servo_epipolar.core.laws.machine import Law, PhaseRow, StateMachine
from visual_servo_epipolar.core.laws.on_arcs import SMOOTH
from visual_servo_epipolar.core.laws.phase import Event, LAW_GROUP, OWN_LAWS, Phase
from visual_servo_epipolar.core.laws.two_steps import CORRECTED, FULL, PAPER, TWO_STEPS
from visual_servo_epipolar.core.registry import Registry

LAWS: Registry[Law] = Registry(
    LAW_GROUP, dict(zip(OWN_LAWS, (PAPER, CORRECTED, FULL, SMOOTH), strict=True)), Law
)
GREY = '#5A5A5A'  # of a phase that no law has


def law_named(name: str) -> Law:
    """Return the law of that name; ValueError if there is none, with all that there are."""
    try:
        return LAWS[name]
    except KeyError:
        raise ValueError(
            f'law must be one of {", ".join(LAWS)}, got {name!r}; a departure is left out by its '
            'setting, as retreat: false in section servo of a scenario'
        ) from None


def machine_of(law: Law, *, on_arcs: bool = False) -> StateMachine:
    """
    Return the state machine of a law: its own, or that of the paper's two steps.

    ``on_arcs``: that of a base which does not turn in place, where the law has one.
    """
    return (law.on_arcs if on_arcs else None) or law.machine or TWO_STEPS


def laws_on_arcs() -> list[str]:
    """Return the names of the laws that drive a base which does not turn in place."""
    names = []
    for name in LAWS:
        with suppress(ValueError):  # broken, which is reported where it is asked for by name
            rows = machine_of(LAWS[name], on_arcs=True).rows
            names += [] if any(phase.turns_in_place for phase in rows) else [name]
    return names


def phase_named(word: str) -> Phase:
    """Return the phase of this word, of any law; ValueError if there is none."""
    row = phase_row(word)
    if row is None:
        raise ValueError(f'{word!r} is no phase of {", ".join(LAWS)}')
    return row.phase


def phase_row(word: str) -> PhaseRow | None:
    """Return the row of the first law that has a phase of this word; None if no law has one."""
    if word not in StateMachine.row_of_word:  # of a law that is not in use here
        for name in LAWS:
            with suppress(ValueError):  # broken, which is reported where it is asked for by name
                _ = LAWS[name]
    return StateMachine.row_of_word.get(word)


def phase_words(word: str) -> str:
    """Return what the robot does in a phase, a verb first; '' where no law has the phase."""
    row = phase_row(word)
    return row.words if row else ''


def phase_colour(word: str) -> str:
    """Return the colour of a phase as '#RRGGBB'; grey where no law has the phase."""
    row = phase_row(word)
    return row.colour if row else GREY


def sentence(phase: Phase, reason: str) -> str:
    """Return in a sentence what the servo does in ``phase``, and the ``reason`` for it, if any."""
    event = Event.known.get(reason)
    reason = event.sentence if event is not None and event.sentence else reason
    if not phase.drives and phase is not Phase.ARRIVED and reason:
        return f'{phase.value}: {reason}'  # and that alone: the robot stands
    because = f'; {reason}' if reason else ''
    return f'{phase.value}: the robot {phase_words(phase.value)}{because}'
