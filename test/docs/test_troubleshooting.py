"""docs/troubleshooting.md quotes messages as the code says them, and every reason of the servo."""

from pathlib import Path
import re

import pytest

from visual_servo_epipolar.core.reasons import Reason

ROOT = Path(__file__).parents[2]
TEXT = (ROOT / 'docs' / 'troubleshooting.md').read_text(encoding='utf-8')
# The first cell of a row: words of the program; `...` stands for numbers and names.
QUOTED = [row for row in re.findall(r'^\| (.+?) \| .+ \|$', TEXT, re.M) if row != 'message']
UNSAID = (Reason.NONE, Reason.OTHER, Reason.SKIPPED)


@pytest.fixture(scope='module')
def source() -> str:
    """Return all source, with string literals that continue on the next line joined."""
    files = sorted((ROOT / 'visual_servo_epipolar').rglob('*.py'))
    text = '\n'.join(file.read_text(encoding='utf-8') for file in files)
    return re.sub(r"""['"]\n\s*f?['"]""", '', text)


def fragments(message: str) -> list[str]:
    return [part.strip() for part in message.split('...') if len(part.strip()) > 3]


@pytest.mark.parametrize('message', QUOTED)
def test_a_quoted_message_is_in_the_source(message: str, source: str) -> None:
    assert fragments(message)
    for fragment in fragments(message):
        assert fragment in source, f'nothing says {fragment!r}'


@pytest.mark.parametrize('reason', [each for each in Reason if each not in UNSAID])
def test_each_reason_is_explained(reason: Reason) -> None:
    assert re.sub(r'\{[^}]*\}', '...', reason.value) in QUOTED


def test_there_are_messages_to_look_up() -> None:
    assert len(QUOTED) >= 20
