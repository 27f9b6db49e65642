"""Each `visual_servo` line of a console block in the documentation is understood as it stands."""

from pathlib import Path
import re
import shlex

import pytest

from visual_servo_epipolar.commands.main import parser

ROOT = Path(__file__).parents[2]
DOCS = ROOT / 'docs'
PAGES = [ROOT / 'README.md', *sorted(DOCS.rglob('*.md'))]
NAMES = sorted(parser().commands)
BLOCK = re.compile(r'^```console\n(.*?)^```', re.M | re.S)


def command_lines() -> list[tuple[str, str]]:
    """Return (page, line), continuation lines joined, comments kept."""
    return [
        (str(page.relative_to(ROOT)), line)
        for page in PAGES
        for block in BLOCK.findall(page.read_text(encoding='utf-8'))
        for line in block.replace('\\\n', ' ').splitlines()
        if line.startswith('visual_servo ')
    ]


@pytest.mark.parametrize(('page', 'line'), command_lines())
def test_the_command_line_is_understood(page: str, line: str) -> None:
    words = shlex.split(line, comments=True)[1:]
    if words in (['--help'], ['--version']):
        return
    options = parser(words).parse_args(words)
    assert callable(options.run), page


def test_each_command_has_its_page() -> None:
    assert sorted(page.stem for page in (DOCS / 'commands').glob('*.md')) == NAMES
    readme = (ROOT / 'README.md').read_text(encoding='utf-8')
    for name in NAMES:
        assert f'(docs/commands/{name}.md)' in readme


@pytest.mark.parametrize('name', NAMES)
def test_the_page_of_a_command_shows_it_at_work(name: str) -> None:
    text = (DOCS / 'commands' / f'{name}.md').read_text(encoding='utf-8')
    assert re.search(rf'^```console\nvisual_servo {name} ', text, re.M)
    for title in ('## Options', '## Exit code', '## JSON'):
        assert f'\n{title}\n' in text, title
