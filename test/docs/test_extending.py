"""What docs/extending.md says of tables: a variant that is missing from one of them is found."""

from dataclasses import fields
from pathlib import Path
import re

from visual_servo_epipolar.commands.console import PHASE_DESCRIPTIONS
from visual_servo_epipolar.core.estimators.registry import ESTIMATORS
from visual_servo_epipolar.core.servo.phases import events
from visual_servo_epipolar.core.servo.phases.table import Phase
from visual_servo_epipolar.core.servo.settings import ServoSettings
from visual_servo_epipolar.core.settings import range_of
from visual_servo_epipolar.report.style import PHASE_COLOURS

ROOT = Path(__file__).parents[2]
PHASES = {phase.value for phase in Phase}


def test_every_phase_has_its_classifier() -> None:
    assert set(events._CLASSIFIERS) == set(Phase)


def test_every_phase_has_words_and_a_colour() -> None:
    assert set(PHASE_DESCRIPTIONS) == PHASES
    assert set(PHASE_COLOURS) == PHASES


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
