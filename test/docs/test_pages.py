"""The pages: links, words, command lines, quoted messages, tables to extend, the glossary."""

from dataclasses import fields
from pathlib import Path
import re
import shlex

from loaded import DOCS, linked, ROOT
import pytest

from visual_servo_epipolar.commands.main import parser
from visual_servo_epipolar.core.geometry.motion import Pose
from visual_servo_epipolar.core.laws.two_steps import TWO_STEPS
from visual_servo_epipolar.core.reasons import Reason
from visual_servo_epipolar.core.servo.run_log import RunLog, Sample, summarise
from visual_servo_epipolar.core.servo.settings import ServoSettings
from visual_servo_epipolar.core.settings import range_of
from visual_servo_epipolar.core.twoview.registry import ESTIMATORS

README = ROOT / 'README.md'
PAGES = [README, *sorted({*ROOT.glob('*.md'), *(ROOT / 'docs').rglob('*.md')} - {README})]
CODE_BLOCK = re.compile(r'^ *```.*?^ *```', re.M | re.S)
LINK = re.compile(r'\]\(([^)\s]+)\)')


def links(page: Path) -> list[str]:
    text = CODE_BLOCK.sub('', page.read_text(encoding='utf-8'))
    return [link for link in LINK.findall(text) if '://' not in link]


def anchors(page: Path) -> set[str]:
    """Return the anchors of a page's headings, as GitHub makes them."""
    text = CODE_BLOCK.sub('', page.read_text(encoding='utf-8'))
    titles = re.findall(r'^#+ (.+)$', text, re.M)
    return {re.sub(r'[^\w\- ]', '', title.lower()).replace(' ', '-') for title in titles}


@pytest.mark.parametrize('page', PAGES, ids=lambda page: str(page.relative_to(ROOT)))
def test_links_lead_somewhere(page: Path) -> None:
    for link in links(page):
        path, _, anchor = link.partition('#')
        target = (page.parent / path).resolve() if path else page
        assert target.exists(), f'{page.name} links to {link}, which is not there'
        if anchor:
            assert anchor in anchors(target), f'{page.name} links to {link}: no such heading'


def test_every_page_can_be_reached_from_the_readme() -> None:
    reached, new = set(), {PAGES[0].resolve()}
    while new:
        reached |= new
        targets = {
            (page.parent / link.partition('#')[0]).resolve()
            for page in new
            for link in links(page)
        }
        new = {target for target in targets if target.suffix == '.md'} - reached
    assert {page.resolve() for page in PAGES} <= reached


def test_pictures_are_small_enough_for_a_page() -> None:
    kinds = {'.png', '.jpg', '.gif', '.webp'}
    sizes = [file.stat().st_size for file in (ROOT / 'docs').rglob('*.*') if file.suffix in kinds]
    assert max(sizes) < 1_000_000
    assert sum(sizes) < 8_000_000


def test_the_pages_are_short_enough_to_be_read() -> None:
    words = {
        page.relative_to(ROOT).as_posix(): len(page.read_text(encoding='utf-8').split())
        for page in PAGES
    }
    assert words['README.md'] <= 1200
    assert words['docs/results.md'] <= 5800
    assert sum(number for name, number in words.items() if name.startswith('docs')) <= 42_000


FILES = [
    *sorted((ROOT / 'visual_servo_epipolar').rglob('*.py')),
    *sorted((ROOT / 'launch').glob('*.py')),
    *sorted({*ROOT.glob('*.md'), *(ROOT / 'docs').rglob('*.md')}),
]
WORDS = re.compile(
    r'\b(nobody|anybody|told|has it|and no more|as good as|by turns|whom|'
    r'(?<!people )(?<!person )(?<!driver )(?<!somebody )who)\b',
    re.IGNORECASE,
)


def test_no_line_has_a_word_for_people_alone() -> None:
    found = [
        f'{path.relative_to(ROOT)}:{number}: {line.strip()}'
        for path in FILES
        for number, line in enumerate(path.read_text(encoding='utf-8').splitlines(), start=1)
        if WORDS.search(line)
    ]
    assert found == [], '\n'.join(found)


PYTHON = re.compile(r'^```python\n(.*?)^```', re.M | re.S)


def test_the_example_of_the_readme_drives_the_robot_home(capsys) -> None:
    (example,) = PYTHON.findall(README.read_text(encoding='utf-8'))
    exec(compile(example, str(README), 'exec'), {})
    printed = capsys.readouterr().out
    assert re.fullmatch(r'arrived \d\.\d mm from the goal\n', printed), printed


MESSAGES = (ROOT / 'docs' / 'troubleshooting.md').read_text(encoding='utf-8')
# The first cell of a row: words of the program; `...` stands for numbers and names.
QUOTED = [row for row in re.findall(r'^\| (.+?) \| .+ \|$', MESSAGES, re.M) if row != 'message']
UNSAID = (Reason.NONE, Reason.OTHER, Reason.SKIPPED)


@pytest.fixture(scope='module')
def source() -> str:
    """Return all source, with string literals that continue on the next line joined."""
    files = sorted((ROOT / 'visual_servo_epipolar').rglob('*.py'))
    text = '\n'.join(file.read_text(encoding='utf-8') for file in files)
    return re.sub(r"""['"]\n\s*f?['"]""", '', text)


def test_quoted_messages_are_in_the_source_and_each_reason_is_explained(source: str) -> None:
    assert len(QUOTED) >= 20
    for message in QUOTED:
        fragments = [part.strip() for part in message.split('...') if len(part.strip()) > 3]
        assert fragments, message
        assert [fragment for fragment in fragments if fragment not in source] == [], message
    reasons = {re.sub(r'\{[^}]*\}', '...', each.value) for each in Reason if each not in UNSAID}
    assert reasons - set(QUOTED) == set()


GLOSSARY = (DOCS / 'glossary.md').read_text(encoding='utf-8')
CODE = sorted(set(re.findall(r'\[`([\w.]+)`\]\(([^)]+\.py)\)', GLOSSARY)))
NUMBERS = sorted(set(re.findall(r'`epipoles/(\w+)`', GLOSSARY)))
RESULTS = sorted(set(re.findall(r'`result\.(\w+)`', GLOSSARY)))


def test_what_is_named_is_in_the_code_and_published() -> None:
    assert all(linked(name, path) is not None for name, path in CODE)
    telemetry = ROOT / 'visual_servo_epipolar' / 'core' / 'servo' / 'telemetry.py'
    text = telemetry.read_text(encoding='utf-8')
    assert [name for name in NUMBERS if f"'{name}':" not in text] == []
    log = RunLog((0.0, -1.0, 0.0), 0, [Sample(0, Pose(0.0, -1.0, 1.5))], 'failed', 'none')
    assert [name for name in RESULTS if name not in summarise(log)] == []
    assert CODE and NUMBERS and RESULTS


def test_the_terms_are_in_alphabetical_order() -> None:
    table = GLOSSARY[GLOSSARY.index('## Words') :]
    terms = re.findall(r'^\| \*\*(.+?)\*\* \|', table, re.M)
    assert len(terms) >= 20
    assert terms == sorted(terms, key=str.lower)


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


CONSOLE_PAGES = [ROOT / 'README.md', *sorted(DOCS.rglob('*.md'))]
NAMES = sorted(parser().commands)
BLOCK = re.compile(r'^```console\n(.*?)^```', re.M | re.S)


def command_lines() -> list[tuple[str, str]]:
    """Return (page, line), continuation lines joined, comments kept."""
    return [
        (str(page.relative_to(ROOT)), line)
        for page in CONSOLE_PAGES
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
