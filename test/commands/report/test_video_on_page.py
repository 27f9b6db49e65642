"""The page of a run shows its video: inside if it is small, linked if it is large."""

import base64
import json
from pathlib import Path
import re
import shutil

from browser import ask_browser, needs_browser, open_in_browser
import cv2
import numpy as np
import pytest

from visual_servo_epipolar.commands import report as on_page
from visual_servo_epipolar.commands.main import main
from visual_servo_epipolar.report.images.video import Codec, CODECS, pyav

needs_pyav = pytest.mark.skipif(pyav() is None, reason='PyAV is not installed')
SIZE, FRAMES = (320, 240), 22
POLICY = re.compile(r'<meta http-equiv="Content-Security-Policy"[^>]*>')
PROBE = """<script>
const video = document.querySelector('video');
const tell = () => fetch('/', {method: 'POST', body: JSON.stringify(
  {error: video.error && video.error.message, width: video.videoWidth, time: video.duration})});
if (video.readyState >= 2 || video.error) { tell(); }
video.onloadeddata = video.onerror = tell;
</script></body>"""


@pytest.fixture(scope='module')
def run_folder(tmp_path_factory) -> Path:
    folder = tmp_path_factory.mktemp('run')
    start = ('--start', '0', '-3', '180')  # ends soon
    assert main(['simulate', *start, '--out', str(folder / 'run')]) == 1
    return folder / 'run'


def page_with(codec: Codec, run_folder: Path, folder: Path) -> Path:
    """Return the page on a run with a video of this codec."""
    shutil.copytree(run_folder, folder / 'my run')
    encoder = codec.open(folder / 'my run' / 'video.mp4', 11.0, SIZE)
    assert encoder is not None
    for k in range(FRAMES):
        encoder.write(np.full((240, 320, 3), 5 * k, dtype=np.uint8))
    encoder.release()
    assert main(['report', str(folder / 'my run'), '--out', str(folder / 'page')]) == 0
    return folder / 'page' / 'report.html'


@needs_pyav
def test_a_small_video_is_inside_the_page(run_folder, tmp_path) -> None:
    text = page_with(CODECS[0], run_folder, tmp_path).read_text(encoding='utf-8')
    content = (tmp_path / 'my run' / 'video.mp4').read_bytes()
    assert f'src="data:video/mp4;base64,{base64.b64encode(content).decode()}"' in text
    assert 'MB inside this page.' in text
    assert text.count('data:image/jpeg') >= 6  # and its pictures, as before


@needs_pyav
@needs_browser
def test_a_browser_plays_it_from_the_page(run_folder, tmp_path) -> None:
    page = page_with(CODECS[0], run_folder, tmp_path)
    _, logged = open_in_browser(page, tmp_path)
    assert 'CONSOLE' not in logged  # the policy of the page lets it be
    text = POLICY.sub('', page.read_text(encoding='utf-8')).replace('</body>', PROBE)
    probe = json.loads(ask_browser(text, tmp_path))
    assert (probe['error'], probe['width']) == (None, SIZE[0])
    assert probe['time'] == pytest.approx(FRAMES / 11.0, abs=0.1)


@needs_pyav
def test_a_large_video_is_linked_from_where_it_lies(run_folder, tmp_path, monkeypatch) -> None:
    monkeypatch.setattr(on_page, 'EMBEDDED_BYTES', 100)
    page = page_with(CODECS[0], run_folder, tmp_path)
    text = page.read_text(encoding='utf-8')
    assert 'src="../my%20run/video.mp4"' in text
    assert 'not inside this page: it is loaded from ../my run/video.mp4' in text
    assert 'data:video' not in text
    assert re.search(r'media-src data: [^;\"]*', text)


@needs_pyav
@needs_browser
def test_the_policy_of_the_page_lets_a_browser_load_a_linked_one(
    run_folder, tmp_path, monkeypatch
) -> None:
    monkeypatch.setattr(on_page, 'EMBEDDED_BYTES', 100)
    page = page_with(CODECS[0], run_folder, tmp_path)
    _, logged = open_in_browser(page, tmp_path)
    assert 'CONSOLE' not in logged


def test_a_video_for_players_alone_is_named_in_words(run_folder, tmp_path) -> None:
    text = page_with(CODECS[-1], run_folder, tmp_path).read_text(encoding='utf-8')
    assert '<video' not in text.partition('</style>')[2]
    named = r'video\.mp4 \((FMP4|mp4v)\) plays in no browser: open it in a video player'
    assert re.search(named, text)  # FFmpeg has two names for the codec
    assert not CODECS[-1].options
    assert text.count('data:image/jpeg') >= 6


def test_a_file_that_is_no_video_is_no_reason_to_stop(run_folder, tmp_path) -> None:
    shutil.copytree(run_folder, tmp_path / 'run')
    (tmp_path / 'run' / 'video.mp4').write_bytes(b'no video')
    assert main(['report', str(tmp_path / 'run'), '--out', str(tmp_path)]) == 0
    assert on_page.codec_of(tmp_path / 'run' / 'video.mp4') == ''
    assert 'unknown codec' in (tmp_path / 'report.html').read_text(encoding='utf-8')


def test_codecs_are_read_as_opencv_names_them(tmp_path) -> None:
    writer = cv2.VideoWriter(str(tmp_path / 'a.avi'), cv2.VideoWriter.fourcc(*'MJPG'), 11.0, SIZE)
    writer.write(np.zeros((240, 320, 3), np.uint8))
    writer.release()
    assert on_page.codec_of(tmp_path / 'a.avi') == 'MJPG'
