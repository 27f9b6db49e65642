"""``visual_servo report``: one page that needs nothing else, opened in a real browser."""

import base64
from html.parser import HTMLParser
import json
from pathlib import Path
import re
import shutil

from bagmaker import decoded, write_bag
from browser import ask_browser, needs_browser, open_in_browser
from command_line import refusal
import cv2
import numpy as np
import pytest
from rclpy.serialization import serialize_message

from visual_servo_epipolar.commands.main import main
from visual_servo_epipolar.messages import event_log, write
from visual_servo_epipolar.report.images.video import pyav
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


def test_a_page_lists_orders_and_settings_with_their_times(small_run, tmp_path) -> None:
    events = [
        ('servo', event_log.Entry('stopped', 4 * PERIOD_NS)),
        ('servo', event_log.Entry('lost', 20 * PERIOD_NS, 'no new tracks for 0.60 s')),
        ('tracker', event_log.Entry('redetected', 2 * PERIOD_NS)),
    ]
    texts = [(f'/{node}_node/events', event_log.to_text(entry)) for node, entry in events]
    settings = next(decoded(m).data for m in small_run if m[0] == '/servo_node/settings')
    changed = settings.replace('turn_gain: 0.8', 'turn_gain: 0.4')
    texts.append(('/servo_node/settings', f'# after_stamp_ns: {11 * PERIOD_NS}\n{changed}'))
    more = [(topic, 9_000_000, serialize_message(write.text(text))) for topic, text in texts]
    path = write_bag(tmp_path / 'told', [*small_run, *more])
    assert main(['report', str(path), '--tracks', '--out', str(tmp_path)]) == 0
    text = (tmp_path / 'report.html').read_text(encoding='utf-8')
    section = text[text.index('<h2>Events') : text.index('<h2>Parameters other')]
    rows = [
        '<td>0.18</td><td>tracker</td><td>all features matched anew, by ~/redetect',
        '<td>0.36</td><td>servo</td><td>stopped, by ~/stop',
        '<td>1.00</td><td>servo</td><td>turn_gain set from 0.8 to 0.4',
        '<td>1.82</td><td>servo</td><td>held, for no tracks came that it may drive by: '
        'no new tracks for 0.60 s',
    ]
    places = [section.find(row) for row in rows]
    assert min(places) > 0, section
    assert places == sorted(places)


def test_versions_of_the_recording_stand_beside_those_of_the_report(bag_page) -> None:
    text = bag_page.read_text(encoding='utf-8')
    section = text[text.index('<h2>Versions') :]
    for version in (np.__version__, cv2.__version__):
        assert section.count(f'<td>{version}</td>') >= 2
    assert 'no service was called and no setting changed' in text


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


needs_pyav = pytest.mark.skipif(pyav() is None, reason='PyAV is not installed')
SIZE, FRAMES = (320, 240), 22
PROBE_VIDEO_ON_PAGE = """<script>
const video = document.querySelector('video');
const tell = () => fetch('/', {method: 'POST', body: JSON.stringify(
  {error: video.error && video.error.message, width: video.videoWidth, time: video.duration})});
if (video.readyState >= 2 || video.error) { tell(); }
video.onloadeddata = video.onerror = tell;
</script></body>"""


@pytest.fixture(scope='module')
def filmed(tmp_path_factory) -> Path:
    """Return the folder of a run with a video."""
    import av

    folder = tmp_path_factory.mktemp('filmed') / 'my run'
    start = ('--start', '0', '-3', '180')  # ends soon
    assert main(['simulate', *start, '--out', str(folder)]) == 1
    with av.open(str(folder / 'video.mp4'), 'w') as film:
        stream = film.add_stream('libx264', rate=11)
        stream.pix_fmt, stream.width, stream.height = 'yuv420p', *SIZE
        for k in range(FRAMES):
            frame = np.full((240, 320, 3), 5 * k, dtype=np.uint8)
            film.mux(stream.encode(av.VideoFrame.from_ndarray(frame, format='bgr24')))
        film.mux(stream.encode())
    return folder


def page_on(folder: Path, out: Path) -> Path:
    assert main(['report', str(folder), '--out', str(out)]) == 0
    return out / 'report.html'


@needs_pyav
def test_a_video_is_inside_the_page(filmed, tmp_path) -> None:
    text = page_on(filmed, tmp_path).read_text(encoding='utf-8')
    content = base64.b64encode((filmed / 'video.mp4').read_bytes()).decode()
    assert f'src="data:video/mp4;base64,{content}"' in text
    assert 'The whole run, 0.0 MB.' in text


@needs_pyav
@needs_browser
def test_a_browser_plays_it_from_the_page(filmed, tmp_path) -> None:
    page = page_on(filmed, tmp_path)
    _, logged = open_in_browser(page, tmp_path)
    assert 'CONSOLE' not in logged  # the policy of the page lets it be
    text = POLICY.sub('', page.read_text(encoding='utf-8')).replace('</body>', PROBE_VIDEO_ON_PAGE)
    probe = json.loads(ask_browser(text, tmp_path))
    assert (probe['error'], probe['width']) == (None, SIZE[0])
    assert probe['time'] == pytest.approx(FRAMES / 11.0, abs=0.1)
