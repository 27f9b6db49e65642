"""A video holds every step and appears only when it is whole."""

import base64
import json
from pathlib import Path
import sys

from browser import ask_browser, needs_browser
import cv2
import numpy as np
import pytest

from visual_servo_epipolar.core.arrays import Image
from visual_servo_epipolar.core.errors import InputError
from visual_servo_epipolar.core.geometry.motion import DESIRED_POSE, Pose
from visual_servo_epipolar.core.laws.registry import phase_colour
from visual_servo_epipolar.core.servo.run_log import RunLog
from visual_servo_epipolar.core.tracking.features import Features
from visual_servo_epipolar.report.images.map_view import MapView, WIDTH
from visual_servo_epipolar.report.images.video import HEIGHT, pyav, VideoWriter
from visual_servo_epipolar.report.style import rgb
from visual_servo_epipolar.simulation.cameras import CameraSettings

CAMERA = CameraSettings(
    width=640, height=512, focal_length=400.0, principal_u=320.0, principal_v=256.0
).nominal_camera
GREY: Image = np.full((512, 640), 90, dtype=np.uint8)
needs_pyav = pytest.mark.skipif(pyav() is None, reason='PyAV is not installed')


def writer(path: Path, pose: Pose = DESIRED_POSE) -> VideoWriter:
    return VideoWriter(path, 11.0, start=pose, camera=CAMERA)


def frames(path: Path) -> list[Image]:
    capture = cv2.VideoCapture(str(path))
    frames: list[Image] = []
    while True:
        there, frame = capture.read()
        if not there:
            return frames
        frames.append(np.asarray(frame, dtype=np.uint8))


@needs_pyav
def test_an_aborted_or_empty_run_leaves_no_file(log: RunLog, tmp_path: Path) -> None:
    with pytest.raises(KeyboardInterrupt), writer(tmp_path / 'run.mp4') as video:
        video.add(GREY, Features(), log.samples[0])
        raise KeyboardInterrupt
    assert list(tmp_path.iterdir()) == []
    with writer(tmp_path / 'run.mp4'):
        pass
    assert list(tmp_path.iterdir()) == []
    with pytest.raises(InputError, match='run.mp4: the video cannot be written: No such file'):
        writer(tmp_path / 'no' / 'run.mp4')


def test_map_is_true_to_scale_with_y_up_and_holds_start_and_goal() -> None:
    view = MapView(Pose(4.0, -9.0, 0.0), HEIGHT)
    origin, right, up = view.pixels(np.array([(0.0, 0.0), (1.0, 0.0), (0.0, 1.0)]))
    assert right[0] - origin[0] == pytest.approx(origin[1] - up[1])
    assert origin[1] > up[1]
    corners = view.pixels(np.array([(4.3, -9.3), (-0.3, 0.3)]))
    assert (corners > 0).all() and (corners < (WIDTH, HEIGHT)).all()


def test_map_shows_the_path_in_the_colour_of_the_phase(log: RunLog) -> None:
    view = MapView(log.samples[0].pose, HEIGHT)
    for sample in log.samples:
        view.add(sample)
    passed = log.samples[70]
    (u, v), *_ = view.pixels(np.array([(passed.pose.x, passed.pose.y)])).round().astype(int)
    drawn = view.picture()[v, u].astype(int)
    assert np.abs(drawn[::-1] - rgb(phase_colour(passed.phase.value))).max() < 30


FRAMES = 33
LARGEST_MB_S = 5.0 / 27.0  # 5 MB for the 27 s of the demo
PLAYER = """<!DOCTYPE html><video muted src="SOURCE"></video>
<script>
const video = document.querySelector('video');
const tell = (result) => fetch('/', {method: 'POST', body: JSON.stringify(result)});
video.onerror = () => tell({error: video.error.code + ' ' + video.error.message});
video.onloadeddata = () => { video.currentTime = 2.0; };
video.onseeked = () => {
  const canvas = document.createElement('canvas');
  canvas.width = video.videoWidth; canvas.height = video.videoHeight;
  const context = canvas.getContext('2d');
  context.drawImage(video, 0, 0);
  tell({size: [video.videoWidth, video.videoHeight], duration: video.duration,
        pixel: [...context.getImageData(30, video.videoHeight - 30, 1, 1).data]});
};
</script>"""


def views() -> list[Image]:
    """Return pictures such as the camera of the demo takes: texture that grows, and noise."""
    rng = np.random.default_rng(1)
    texture = cv2.GaussianBlur(rng.uniform(0.0, 255.0, (512, 640)), (0, 0), 3.0)
    texture = 128.0 + 6.0 * (texture - texture.mean())
    pictures = []
    for k in range(FRAMES):
        zoom = cv2.getRotationMatrix2D((320.0, 256.0), 0.0, 1.0 + 0.004 * k)
        view = cv2.warpAffine(texture, zoom, (640, 512)) + rng.normal(0.0, 2.0, texture.shape)
        view[-60:, :60] = 40.0
        pictures.append(view.clip(0, 255).astype(np.uint8))
    return pictures


def film(path: Path, log: RunLog) -> VideoWriter:
    with writer(path, log.samples[0].pose) as video:
        for view, sample in zip(views(), log.samples, strict=False):
            video.add(view, Features(), sample)
    return video


def played(path: Path, folder: Path) -> dict[str, object]:
    """Return what a browser makes of a video: its size, duration, and a pixel of second 2."""
    kind = path.suffix.lstrip('.')
    source = f'data:video/{kind};base64,{base64.b64encode(path.read_bytes()).decode()}'
    return json.loads(ask_browser(PLAYER.replace('SOURCE', source), folder))


@needs_pyav
def test_the_video_has_all_frames_in_a_codec_that_browsers_play_and_is_small(
    log, tmp_path
) -> None:
    path = tmp_path / 'run.mp4'
    video = film(path, log)
    with pyav().open(str(path)) as container:
        stream = container.streams.video[0]
        assert (stream.codec_context.name, stream.codec_context.pix_fmt) == ('h264', 'yuv420p')
        assert float(stream.average_rate) == pytest.approx(11.0)
    read = frames(path)
    assert len(read) == video.frames == FRAMES
    assert read[0].shape == (HEIGHT, video.size[0], 3) and video.size[0] % 2 == 0
    # Camera left, map right; codecs keep flat colours to some grey levels.
    assert np.abs(read[22][HEIGHT - 30, 30].astype(int) - 40).max() < 12
    assert read[-1][60, -60:].min() > 200
    content = path.read_bytes()
    assert content.index(b'moov') < content.index(b'mdat')  # the index is before the frames
    assert len(content) < 1e6 * LARGEST_MB_S * FRAMES / 11.0
    assert list(tmp_path.iterdir()) == [path]


@needs_pyav
@needs_browser
def test_a_browser_plays_it(log, tmp_path) -> None:
    video = film(tmp_path / 'run.mp4', log)
    result = played(tmp_path / 'run.mp4', tmp_path)
    assert result['size'] == list(video.size)
    assert result['duration'] == pytest.approx(FRAMES / 11.0, abs=0.1)
    assert np.abs(np.array(result['pixel'][:3]) - 40).max() < 12


def test_without_pyav_there_is_none_and_what_to_install(log, tmp_path, monkeypatch) -> None:
    monkeypatch.setitem(sys.modules, 'av', None)
    with pytest.raises(InputError, match='needs PyAV; pip install av, or apt install python3-av'):
        film(tmp_path / 'run.mp4', log)
    assert list(tmp_path.iterdir()) == []


@needs_pyav
@pytest.mark.skipif(not Path('/dev/full').exists(), reason='no /dev/full')
def test_a_full_disk_is_reported_in_one_line(log, tmp_path: Path) -> None:
    (tmp_path / '.run.part.mp4').symlink_to('/dev/full')
    with pytest.raises(InputError, match='the video cannot be written: .*; make room there'):
        film(tmp_path / 'run.mp4', log)
