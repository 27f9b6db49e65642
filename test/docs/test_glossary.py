"""docs/glossary.md: what it links exists, and names of topics and JSON fields are real."""

from importlib import import_module
from pathlib import Path
import re
from typing import Any

import pytest

from visual_servo_epipolar.core.geometry.motion import Pose
from visual_servo_epipolar.core.servo.run_log import RunLog, Sample, summarise

ROOT = Path(__file__).parents[2]
DOCS = ROOT / 'docs'
TEXT = (DOCS / 'glossary.md').read_text(encoding='utf-8')
CODE = sorted(set(re.findall(r'\[`([\w.]+)`\]\(([^)]+\.py)\)', TEXT)))
NUMBERS = sorted(set(re.findall(r'`epipoles/(\w+)`', TEXT)))
RESULTS = sorted(set(re.findall(r'`result\.(\w+)`', TEXT)))


def resolve(name: str, path: str) -> Any:
    """Return what ``name``, such as Bearings.alpha, is in the file that the link leads to."""
    file = (DOCS / path).resolve()
    found: Any = import_module('.'.join(file.relative_to(ROOT).with_suffix('').parts))
    for part in name.split('.'):
        fields = getattr(found, '__dataclass_fields__', {})
        found = fields[part] if part in fields else getattr(found, part)
    return found


@pytest.mark.parametrize(('name', 'path'), CODE)
def test_what_is_named_is_in_the_code(name: str, path: str) -> None:
    assert resolve(name, path) is not None


@pytest.mark.parametrize('name', NUMBERS)
def test_a_number_of_the_topic_is_published(name: str) -> None:
    source = ROOT / 'visual_servo_epipolar' / 'core' / 'servo' / 'telemetry.py'
    assert f"'{name}':" in source.read_text(encoding='utf-8')


@pytest.mark.parametrize('name', RESULTS)
def test_a_field_of_the_result_is_written(name: str) -> None:
    log = RunLog((0.0, -1.0, 0.0), 0, [Sample(0, Pose(0.0, -1.0, 1.5))], 'failed', 'none')
    assert name in summarise(log)


def test_the_terms_are_in_alphabetical_order() -> None:
    table = TEXT[TEXT.index('## Words') :]
    terms = re.findall(r'^\| \*\*(.+?)\*\* \|', table, re.M)
    assert len(terms) >= 20
    assert terms == sorted(terms, key=str.lower)
