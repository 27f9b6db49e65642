"""What docs/extending.md says of tables: a variant that is missing from one of them is found."""

from dataclasses import fields
from pathlib import Path
import re

import pytest

from visual_servo_epipolar.core.laws.two_steps import TWO_STEPS
from visual_servo_epipolar.core.servo.settings import ServoSettings
from visual_servo_epipolar.core.settings import range_of
from visual_servo_epipolar.core.twoview.registry import ESTIMATORS

ROOT = Path(__file__).parents[2]


@pytest.mark.parametrize('name', ['words', 'colour'])
def test_words_and_colour_of_a_phase_are_its_own(name: str) -> None:
    values = [getattr(row, name) for row in TWO_STEPS.rows.values()]
    assert all(values) and len(set(values)) == len(values)


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
