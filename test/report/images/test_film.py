"""A film is drawn by another process: the same video, no file without an end, errors come back."""

import multiprocessing
import os
import signal

import numpy as np
import pytest

from visual_servo_epipolar.core.cameras.model import field_of_view
from visual_servo_epipolar.core.errors import InputError, VisualServoError
from visual_servo_epipolar.core.geometry.motion import Pose, Twist
from visual_servo_epipolar.core.laws.phase import Phase
from visual_servo_epipolar.core.servo.run_log import Sample
from visual_servo_epipolar.core.tracking.features import Features
from visual_servo_epipolar.report.images import film as film_of_runs
from visual_servo_epipolar.report.images.film import Film, VideoWriter, view_size
from visual_servo_epipolar.report.images.map_view import MapBounds
from visual_servo_epipolar.report.images.picture import picture
from visual_servo_epipolar.simulation.mounts.camera_settings import CameraSettings

SETTINGS = CameraSettings(
    width=160, height=128, focal_length=100.0, principal_u=80.0, principal_v=64.0
)
CAMERA = SETTINGS.nominal_camera
BOUNDS = MapBounds.around(Pose.from_start(1.0, -3.0, 5.0))
FPS, STEPS = 11.0, 12


def step(number: int) -> tuple[np.ndarray, Features, Sample]:
    image = np.full((128, 160), 100 + 5 * number, np.uint8)
    sample = Sample(
        stamp_ns=number,
        pose=Pose.from_start(1.0, -3.0 + 0.1 * number, 5.0),
        twist=Twist(0.1, 0.0),
        phase=Phase.DISPLACING,
        features=0,
        epipole_current=-30.0,
        epipole_desired=20.0,
        bearing_current=0.1,
        bearing_desired=0.2,
        feature_difference=1.0,
        feature_error=1.0,
        distance_estimate=2.0,
    )
    return image, Features(), sample


@pytest.mark.parametrize('waiting', [2, 256])
def test_the_film_is_the_video_of_one_process(waiting, tmp_path, monkeypatch) -> None:
    for limit in ('LEAST_WAITING', 'MOST_WAITING'):
        monkeypatch.setattr(film_of_runs, limit, waiting)
    with Film(tmp_path / 'film.mp4', FPS, bounds=BOUNDS, camera=CAMERA) as film:
        for number in range(STEPS):
            film.add(*step(number))
        film.end()
    size = view_size((160, 128))
    angle = field_of_view(CAMERA)
    with VideoWriter(
        tmp_path / 'a.mp4', FPS, width=size[0], bounds=BOUNDS, field_of_view=angle
    ) as video:
        for number in range(STEPS):
            image, features, sample = step(number)
            video.add(picture(image, features, sample, CAMERA, size), sample)
    assert film.advice == video.advice
    assert (tmp_path / 'film.mp4').read_bytes() == (tmp_path / 'a.mp4').read_bytes()


def test_a_run_that_breaks_leaves_no_file_and_no_process(tmp_path) -> None:
    with (
        pytest.raises(KeyboardInterrupt),
        Film(tmp_path / 'film.mp4', FPS, bounds=BOUNDS, camera=CAMERA) as film,
    ):
        film.add(*step(0))
        raise KeyboardInterrupt
    assert not list(tmp_path.iterdir())
    assert not multiprocessing.active_children()


def test_a_film_that_cannot_be_written_is_refused_before_the_run(tmp_path) -> None:
    with (
        pytest.raises(InputError, match='must be a folder'),
        Film(tmp_path / 'no' / 'film.mp4', FPS, bounds=BOUNDS, camera=CAMERA) as film,
    ):
        pytest.fail(f'the run begins, with {film.advice!r}')


def test_what_the_writer_refuses_comes_out_of_the_block(tmp_path) -> None:
    image, features, sample = step(0)
    with (
        pytest.raises(ValueError, match='images must have 160x128'),
        Film(tmp_path / 'film.mp4', FPS, bounds=BOUNDS, camera=CAMERA) as film,
    ):
        film.add(image[::2], features, sample)
    assert not list(tmp_path.iterdir())


def test_a_process_that_is_killed_is_told_of(tmp_path) -> None:
    with (
        pytest.raises(VisualServoError, match='died'),
        Film(tmp_path / 'film.mp4', FPS, bounds=BOUNDS, camera=CAMERA) as film,
    ):
        (process,) = multiprocessing.active_children()
        os.kill(process.pid, signal.SIGKILL)
        process.join(30.0)
        for number in range(STEPS):
            film.add(*step(number))
