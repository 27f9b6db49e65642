"""``visual_servo report``: one page that needs nothing else, opened in a real browser."""

from html.parser import HTMLParser
import json
from pathlib import Path
import re
import shutil

from bagmaker import write_bag
from browser import needs_browser, open_in_browser
from command_line import refusal
import cv2
import numpy as np
import pytest

from visual_servo_epipolar.commands.main import main
from visual_servo_epipolar.report.page import Headline, Section, write_page

PERIOD_NS = 90_909_091
POLICY = re.compile(r'<meta http-equiv="Content-Security-Policy"[^>]*>')
# Written into a copy of the page: what the browser made of it.
PROBE = """
<pre id="probe"></pre>
<script>
addEventListener('load', () => {
  const images = [...document.images];
  document.getElementById('probe').textContent = JSON.stringify({
    widths: images.map((image) => image.naturalWidth),
    broken: images.filter((image) => !image.complete || !image.alt).length,
    requests: performance.getEntriesByType('resource').map((entry) => entry.name),
    verdict: document.querySelector('.verdict').innerText,
    wide: document.documentElement.scrollWidth > window.innerWidth,
  });
});
</script>
</body>"""


class References(HTMLParser):
    """Collects what a page would load."""

    def __init__(self) -> None:
        super().__init__()
        self.urls: list[str] = []
        self.tags: list[str] = []

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        self.tags.append(tag)
        self.urls += [value or '' for name, value in attrs if name in ('src', 'href', 'srcset')]


@pytest.fixture(scope='module')
def run_page(tmp_path_factory) -> Path:
    """Return the report on a simulated run."""
    folder = tmp_path_factory.mktemp('run')
    main(['simulate', '--start', '1', '-3', '0', '--seed', '1', '--out', str(folder / 'run')])
    assert main(['report', str(folder / 'run'), '--out', str(folder / 'page')]) == 0
    return folder / 'page' / 'report.html'


@pytest.fixture(scope='module')
def bag(small_run, tmp_path_factory) -> Path:
    return write_bag(tmp_path_factory.mktemp('bags') / 'run <b>&', small_run)


@pytest.fixture(scope='module')
def bag_page(bag, tmp_path_factory) -> Path:
    """Return the report on a recorded run."""
    folder = tmp_path_factory.mktemp('page')
    assert main(['report', str(bag), '--out', str(folder)]) == 0
    return folder / 'report.html'


@pytest.mark.parametrize('kind', ['run_page', 'bag_page'])
def test_a_page_loads_nothing_from_anywhere(kind, request) -> None:
    references = References()
    references.feed(request.getfixturevalue(kind).read_text(encoding='utf-8'))
    assert len(references.urls) >= 3
    assert all(item.startswith('data:') for item in references.urls)
    assert 'script' not in references.tags


@needs_browser
@pytest.mark.parametrize(('kind', 'figures'), [('run_page', 2), ('bag_page', 2)])
def test_a_browser_shows_it_without_errors_or_network(kind, figures, request, tmp_path) -> None:
    page = request.getfixturevalue(kind)
    _, logged = open_in_browser(page, tmp_path)
    assert 'CONSOLE' not in logged
    text = page.read_text(encoding='utf-8')
    probed = tmp_path / 'probed.html'
    probed.write_text(POLICY.sub('', text).replace('</body>', PROBE), encoding='utf-8')
    shown, logged = open_in_browser(probed, tmp_path)
    assert 'CONSOLE' not in logged
    probe = json.loads(re.search(r'<pre id="probe">(.*?)</pre>', shown, re.DOTALL)[1])
    assert len(probe['widths']) >= figures
    assert min(probe['widths']) > 100
    assert (probe['broken'], probe['requests'], probe['wide']) == (0, [], False)
    assert probe['verdict']
    assert probe['verdict'] in text


def test_the_page_on_a_run_says_first_how_it_ended(run_page) -> None:
    text = run_page.read_text(encoding='utf-8')
    verdict = text.index('Arrived after')
    assert verdict < text.index('<h2>Result')
    for heading in ('Path', 'Signals', 'Phases', 'Parameters other than the default', 'Versions'):
        assert f'<h2>{heading}</h2>' in text
    assert '<td>servo.seed</td><td>1</td><td>0</td>' in text
    assert 'visual_servo_epipolar' in text


def test_the_page_on_a_bag_compares(bag_page) -> None:
    text = bag_page.read_text(encoding='utf-8')
    assert 'the same to the last bit' in text
    assert 'Bag run &lt;b&gt;&amp;, ' in text  # a name is no markup
    assert 'Not arrived' not in text


def test_a_bag_can_be_reported_with_other_parameters(bag, tmp_path) -> None:
    assert (
        main(['report', str(bag), '--tracks', '--set', 'servo.k1=0.2', '--out', str(tmp_path)])
        == 0
    )
    text = (tmp_path / 'report.html').read_text(encoding='utf-8')
    assert '<td>servo.k1</td><td>0.2</td>' in text


def test_what_is_neither_run_nor_bag_is_refused_and_leaves_nothing(tmp_path, capsys) -> None:
    (tmp_path / 'empty').mkdir()
    for name in ('empty', 'nowhere'):
        error = refusal(capsys, 'report', str(tmp_path / name), '--out', str(tmp_path / 'out'))
        assert 'bag' in error
    assert not (tmp_path / 'out').exists()


def test_a_run_cannot_be_changed_afterwards(run_page, tmp_path, capsys) -> None:
    source = str(run_page.parents[1] / 'run')
    error = refusal(capsys, 'report', source, '--set', 'servo.k1=0.2', '--out', str(tmp_path))
    assert 'is no bag: --set cannot change what is in it' in error


def test_a_page_goes_beside_the_run_by_default(run_page, capsys) -> None:
    folder = run_page.parents[1] / 'run'
    assert main(['report', str(folder / 'run.json')]) == 0
    page = folder / 'report.html'
    assert capsys.readouterr().out == f'written: {page}\n'
    page.unlink()


@pytest.mark.long
def test_a_page_on_a_bag_goes_beside_it_not_into_it(bag, tmp_path, monkeypatch, capsys) -> None:
    copy = shutil.copytree(bag, tmp_path / 'mine')
    before = sorted(copy.iterdir())
    monkeypatch.chdir(copy)
    for source in ('../mine', '.', 'mine_0.mcap'):
        if source.endswith('.mcap'):
            next(copy.glob('*.mcap')).rename(tmp_path / source)
            monkeypatch.chdir(tmp_path)
        assert main(['report', source, '--tracks']) == 0
        place = 'mine_0_report' if source.endswith('.mcap') else 'mine_report'
        assert (tmp_path / place / 'report.html').is_file()
        assert f'{place}/report.html' in capsys.readouterr().out
        shutil.rmtree(tmp_path / place)
        if not source.endswith('.mcap'):
            assert sorted(copy.iterdir()) == before


def test_versions_of_the_recording_stand_beside_those_of_the_report(bag_page) -> None:
    text = bag_page.read_text(encoding='utf-8')
    section = text[text.index('<h2>Versions') :]
    for version in (np.__version__, cv2.__version__):
        assert section.count(f'<td>{version}</td>') >= 2


@pytest.mark.parametrize('ending', [KeyboardInterrupt, OSError(28, 'No space left on device')])
def test_nothing_is_left_of_a_cut(bag, run_page, tmp_path, monkeypatch, capsys, ending) -> None:
    from visual_servo_epipolar.commands import report as command

    def end(*_: object, **__: object) -> None:
        raise ending

    monkeypatch.setattr(command, 'write_page', end)
    monkeypatch.setattr(command.figures, 'signals', lambda *_: command.figures.new_figure(1, 1))
    for source in (bag, run_page.parents[1] / 'run'):
        options = ('--tracks',) if source == bag else ()
        out = tmp_path / 'made' / 'out'
        assert main(['report', str(source), *options, '--out', str(out)]) in (2, 130)
        assert list(tmp_path.iterdir()) == []


WIDE = """<script>addEventListener('load', () => {
  const page = document.documentElement;
  page.dataset.wide = page.scrollWidth > window.innerWidth;
});</script></main>"""


@pytest.mark.parametrize('command', ['report', 'replay'])
def test_of_a_folder_with_a_bag_in_it_the_bag_is_named(command, tmp_path, capsys) -> None:
    (tmp_path / 'bag').mkdir()  # as a demo that was interrupted leaves it
    (tmp_path / 'bag' / 'metadata.yaml').touch()
    reason = f'not a bag, but a folder with one; give {tmp_path / "bag"}'
    assert reason in refusal(capsys, command, str(tmp_path))


@needs_browser
def test_long_notes_are_broken_into_lines(tmp_path) -> None:
    page = tmp_path / 'long.html'
    note = f'<pre>{"a note of many words " * 30}</pre>'
    write_page(page, 'title', Headline('Arrived', True, ''), [Section('Notes', note)])
    text = POLICY.sub('', page.read_text(encoding='utf-8'))
    page.write_text(text.replace('</main>', WIDE), encoding='utf-8')
    shown, _ = open_in_browser(page, tmp_path)
    assert 'data-wide="false"' in shown
