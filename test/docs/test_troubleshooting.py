"""docs/troubleshooting.md quotes messages as the code says them."""

from pathlib import Path
import re

import pytest

ROOT = Path(__file__).parents[2]
TEXT = (ROOT / 'docs' / 'troubleshooting.md').read_text(encoding='utf-8')
# A quoted message: `> words of the program`; `...` stands for numbers and names.
QUOTED = re.findall(r'^> (.+)$', TEXT, re.M)


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


def test_there_are_messages_to_look_up() -> None:
    assert len(QUOTED) >= 20
