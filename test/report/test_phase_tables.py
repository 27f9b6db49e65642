"""Every phase has its row in every table: whoever adds one learns here what else it needs."""

import pytest

from visual_servo_epipolar.commands.console import PHASE_DESCRIPTIONS
from visual_servo_epipolar.core.servo.phases import events
from visual_servo_epipolar.core.servo.phases.table import ENDED, Event, Phase, TRANSITIONS
from visual_servo_epipolar.report.style import PHASE_COLOURS, UNKNOWN_COLOUR


@pytest.mark.parametrize('phase', Phase)
def test_a_phase_has_a_colour_of_its_own(phase: Phase) -> None:
    colour = PHASE_COLOURS[phase.value]
    assert colour != UNKNOWN_COLOUR
    assert [name for name, other in PHASE_COLOURS.items() if other == colour] == [phase.value]


@pytest.mark.parametrize('phase', Phase)
def test_a_phase_is_described_in_words_of_its_own(phase: Phase) -> None:
    words = PHASE_DESCRIPTIONS[phase.value]
    assert words
    assert [name for name, other in PHASE_DESCRIPTIONS.items() if other == words] == [phase.value]


@pytest.mark.parametrize('phase', Phase)
def test_a_phase_has_a_way_in(phase: Phase) -> None:
    assert any(then is phase and start is not phase for (start, _), then in TRANSITIONS.items())


@pytest.mark.parametrize('phase', Phase)
def test_a_phase_has_a_way_out(phase: Phase) -> None:
    exits = {
        event
        for (start, event), then in TRANSITIONS.items()
        if start is phase and then is not phase
    }
    # Of an ended run the only one; any other phase ends by itself as well.
    assert exits == {Event.STOPPED} if phase in ENDED else exits - {Event.STOPPED}


@pytest.mark.parametrize('phase', Phase)
def test_a_phase_has_a_classifier_of_its_events(phase: Phase) -> None:
    assert phase in events._CLASSIFIERS


@pytest.mark.parametrize('phase', Phase)
def test_a_phase_has_a_command(phase: Phase) -> None:
    from visual_servo_epipolar.core.servo.phases.commands import COMMANDS

    assert phase in COMMANDS


@pytest.mark.parametrize('table', [PHASE_COLOURS, PHASE_DESCRIPTIONS])
def test_a_table_has_no_row_of_a_phase_that_is_gone(table: dict[str, str]) -> None:
    assert table.keys() == {phase.value for phase in Phase}
