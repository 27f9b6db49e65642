"""What docs/extending.md says of tables: a variant that is missing from one of them is found."""

from dataclasses import fields
from pathlib import Path
import re
from typing import Any

import pytest

from visual_servo_epipolar.commands.console import PHASE_DESCRIPTIONS
from visual_servo_epipolar.core.estimators.registry import ESTIMATORS
from visual_servo_epipolar.core.laws.phases.commands import COMMANDS
from visual_servo_epipolar.core.laws.phases.events import _CLASSIFIERS
from visual_servo_epipolar.core.laws.phases.table import ENDED, Event, Phase, TRANSITIONS
from visual_servo_epipolar.core.servo.settings import ServoSettings
from visual_servo_epipolar.core.settings import range_of
from visual_servo_epipolar.report.style import PHASE_COLOURS

ROOT = Path(__file__).parents[2]
WORDS = {phase.value for phase in Phase}


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


@pytest.mark.parametrize(
    ('table', 'phases'),
    [
        (_CLASSIFIERS, set(Phase)),
        (COMMANDS, set(Phase)),
        (PHASE_COLOURS, WORDS),
        (PHASE_DESCRIPTIONS, WORDS),
    ],
    ids=['classifiers', 'commands', 'colours', 'words'],
)
def test_a_table_of_phases_has_a_row_for_each_and_no_other(
    table: dict[Any, Any], phases: set[Any]
) -> None:
    assert set(table) == phases


def test_the_words_of_a_phase_are_its_own() -> None:
    assert all(PHASE_DESCRIPTIONS.values())
    assert len(set(PHASE_DESCRIPTIONS.values())) == len(PHASE_DESCRIPTIONS)


def test_every_estimator_of_our_own_is_named_in_the_setting() -> None:
    setting = next(item for item in fields(ServoSettings) if item.name == 'estimator')
    for name, estimator in ESTIMATORS.items():
        if estimator.__module__.startswith('visual_servo_epipolar.'):
            assert f'{name} (' in range_of(setting).text


def test_the_tests_that_are_named_exist() -> None:
    text = (ROOT / 'docs' / 'extending.md').read_text(encoding='utf-8')
    named = set(re.findall(r'test/[\w/]+(?:\.py)?', text))
    assert named
    assert [name for name in sorted(named) if not (ROOT / name).exists()] == []
