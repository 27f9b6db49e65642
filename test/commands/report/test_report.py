"""``visual_servo report``: one page that needs nothing else, opened in a real browser."""

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


@pytest.fixture(scope='module')
def run_page(tmp_path_factory) -> Path:
    folder = tmp_path_factory.mktemp('run')
    main(['simulate', '--start', '1', '-3', '0', '--seed', '1', '--out', str(folder / 'run')])
    assert main(['report', str(folder / 'run'), '--out', str(folder / 'page')]) == 0
    return folder / 'page' / 'report.html'


@pytest.fixture(scope='module')
def bag(small_run, tmp_path_factory) -> Path:
    return write_bag(tmp_path_factory.mktemp('bags') / 'run <b>&', small_run)


@pytest.fixture(scope='module')
def bag_page(bag, tmp_path_factory) -> Path:
    folder = tmp_path_factory.mktemp('page')
    assert main(['report', str(bag), '--out', str(folder)]) == 0
    return folder / 'report.html'


@pytest.fixture
def long_page(tmp_path) -> Path:
    """Return a page with a note that is to be broken into lines."""
    note = f'<pre>{"a note of many words " * 30}</pre>'
    sections = [Section('Notes', note)]
    return write_page(tmp_path / 'long.html', 'title', Headline('Arrived', True, ''), sections)


@pytest.mark.parametrize('kind', ['run_page', 'bag_page'])
def test_a_page_loads_nothing_from_anywhere(kind, request) -> None:
    text = request.getfixturevalue(kind).read_text(encoding='utf-8')
    urls = re.findall(r'\b(?:src|href|srcset)="([^"]*)"', text)
    assert len(urls) >= 3
    assert all(url.startswith('data:') for url in urls)
    assert '<script' not in text


@needs_browser
@pytest.mark.parametrize('kind', ['run_page', 'bag_page', 'long_page'])
def test_a_browser_shows_it_without_errors_or_network(kind, request, tmp_path) -> None:
    page = request.getfixturevalue(kind)
    _, logged = open_in_browser(page, tmp_path)
    assert 'CONSOLE' not in logged
    text = page.read_text(encoding='utf-8')
    probed = tmp_path / 'probed.html'
    probed.write_text(POLICY.sub('', text).replace('</body>', PROBE), encoding='utf-8')
    shown, logged = open_in_browser(probed, tmp_path)
    assert 'CONSOLE' not in logged
    probe = json.loads(re.search(r'<pre id="probe">(.*?)</pre>', shown, re.DOTALL)[1])
    assert len(probe['widths']) >= 2 * (kind != 'long_page')
    assert min(probe['widths'], default=999) > 100
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
    section = text[text.index('<h2>Versions') :]
    for version in (np.__version__, cv2.__version__):  # of the recording, and of the report
        assert section.count(f'<td>{version}</td>') >= 2


def test_a_bag_can_be_reported_with_other_parameters_and_a_run_cannot(
    bag, run_page, tmp_path, capsys
) -> None:
    words = ('--set', 'servo.k1=0.2', '--out', str(tmp_path))
    assert main(['report', str(bag), '--tracks', *words]) == 0
    text = (tmp_path / 'report.html').read_text(encoding='utf-8')
    assert '<td>servo.k1</td><td>0.2</td>' in text
    capsys.readouterr()
    error = refusal(capsys, 'report', str(run_page.parents[1] / 'run'), *words)
    assert 'is no bag: --set cannot change what is in it' in error


@pytest.mark.parametrize('command', ['report', 'replay'])
def test_what_is_neither_run_nor_bag_is_refused_and_leaves_nothing(
    command, tmp_path, capsys
) -> None:
    for name in ('empty', 'out/bag'):  # as a demo that was interrupted leaves it
        (tmp_path / name).mkdir(parents=True)
    (tmp_path / 'out/bag/metadata.yaml').touch()
    whole = f'not a bag, but a folder with one; give {tmp_path / "out/bag"}'
    for name, reason in (('empty', 'bag'), ('nowhere', 'bag'), ('out', whole)):
        words = (str(tmp_path / name), '--out', str(tmp_path / 'made'))
        assert reason in refusal(capsys, command, *words)
    assert not (tmp_path / 'made').exists()


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
