"""A video holds every step and appears only when it is whole."""

from collections.abc import Sequence
from pathlib import Path

import cv2
import numpy as np
import pytest

from visual_servo_epipolar.core.arrays import Image
from visual_servo_epipolar.core.errors import InputError
from visual_servo_epipolar.core.geometry.motion import DESIRED_POSE, Pose
from visual_servo_epipolar.core.laws.registry import phase_colour
from visual_servo_epipolar.core.servo.run_log import RunLog, Sample
from visual_servo_epipolar.core.tracking.features import Features
from visual_servo_epipolar.report.images.map_view import HEADER, MapBounds, MapView, WIDTH
from visual_servo_epipolar.report.images.video import Codec, HEIGHT, VideoWriter
from visual_servo_epipolar.report.style import rgb
from visual_servo_epipolar.simulation.mounts.camera_settings import CameraSettings

CAMERA = CameraSettings(
    width=320, height=200, focal_length=200.0, principal_u=160.0, principal_v=100.0
).nominal_camera
GREY: Image = np.full((200, 320), 90, dtype=np.uint8)


def writer(path: Path, pose: Pose = DESIRED_POSE) -> VideoWriter:
    return VideoWriter(path, 11.0, bounds=MapBounds.around(pose), camera=CAMERA)


def write(path: Path, samples: Sequence[Sample]) -> VideoWriter:
    with writer(path, samples[0].pose) as video:
        for sample in samples:
            video.add(GREY, Features(), sample)
    return video


def frames(path: Path) -> list[Image]:
    capture = cv2.VideoCapture(str(path))
    frames: list[Image] = []
    while True:
        there, frame = capture.read()
        if not there:
            return frames
        frames.append(np.asarray(frame, dtype=np.uint8))


def test_video_can_be_read_again(log: RunLog, tmp_path: Path) -> None:
    path = tmp_path / 'run.mp4'
    video = write(path, log.samples[:12])
    read = frames(path)
    assert len(read) == video.frames == 12
    assert read[0].shape == (HEIGHT, video.size[0], 3)
    assert video.size[0] % 2 == 0
    # Camera left, map right; codecs keep flat colours to some grey levels.
    assert np.abs(read[-1][400, 300].astype(int) - 90).max() < 25
    assert read[-1][HEADER + 4, -60:].min() > 200
    assert list(tmp_path.iterdir()) == [path]


def test_aborted_run_leaves_no_file(log: RunLog, tmp_path: Path) -> None:
    with pytest.raises(KeyboardInterrupt), writer(tmp_path / 'run.mp4') as video:
        video.add(GREY, Features(), log.samples[0])
        raise KeyboardInterrupt
    assert list(tmp_path.iterdir()) == []


def test_video_without_frames_is_no_file(tmp_path: Path) -> None:
    with writer(tmp_path / 'run.mp4'):
        pass
    assert list(tmp_path.iterdir()) == []


def test_file_that_cannot_be_written_is_refused(tmp_path: Path) -> None:
    with pytest.raises(InputError, match='folder'):
        writer(tmp_path / 'no' / 'run.mp4')


def test_missing_encoder_is_told_in_one_sentence(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    codecs = Codec('none such', {'g': '110'}), Codec('zzzz')
    monkeypatch.setattr('visual_servo_epipolar.report.images.video.CODECS', codecs)
    with pytest.raises(InputError, match='needs one of the encoders none such, zzzz'):
        writer(tmp_path / 'run.mp4')
    assert list(tmp_path.iterdir()) == []


def test_map_shows_the_path_in_the_colour_of_the_phase(log: RunLog) -> None:
    view = MapView(MapBounds.around(log.samples[0].pose), HEIGHT)
    for sample in log.samples:
        view.add(sample)
    passed = log.samples[70]
    (u, v), *_ = view.pixels(np.array([(passed.pose.x, passed.pose.y)])).round().astype(int)
    drawn = view.picture()[v, u].astype(int)
    assert np.abs(drawn[::-1] - rgb(phase_colour(passed.phase.value))).max() < 30


def test_map_grows_to_hold_a_robot_that_leaves_it(log: RunLog) -> None:
    view = MapView(MapBounds.around(log.samples[0].pose), HEIGHT)
    view.add(log.samples[0])
    away = Sample(stamp_ns=10**9, pose=Pose(4.0, -9.0, 0.0))
    view.add(away)
    corners = view.pixels(np.array([(4.0, -9.0), (0.0, 0.0), (-0.6, -3.0)]))
    assert (corners > (0, HEADER)).all()
    assert (corners < (WIDTH, HEIGHT)).all()


def test_map_is_true_to_scale_with_y_up() -> None:
    view = MapView(MapBounds(-1.0, 1.0, -3.0, 0.0), HEIGHT)
    origin, right, up = view.pixels(np.array([(0.0, 0.0), (1.0, 0.0), (0.0, 1.0)]))
    assert right[0] - origin[0] == pytest.approx(origin[1] - up[1])
    assert origin[1] > up[1]
