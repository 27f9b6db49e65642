"""Teaching: what cannot become a route is refused, with what to do."""

from pathlib import Path

import numpy as np
import pytest

from visual_servo_epipolar.core.arrays import Image
from visual_servo_epipolar.core.cameras.registry import calibrated_camera
from visual_servo_epipolar.core.errors import DegenerateGeometryError
from visual_servo_epipolar.core.geometry.motion import Pose
from visual_servo_epipolar.core.routes.settings import TeachSettings
from visual_servo_epipolar.core.routes.teaching import Teacher
from visual_servo_epipolar.evaluation.benchmarks.estimation.routes import read_clips

DONKEY = Path(__file__).parents[2] / 'evaluation' / 'benchmarks' / 'estimation' / 'donkey'
SIZE = (160, 120)
CAMERA = calibrated_camera(SIZE, (100.0, 0.0, 79.5, 0.0, 100.0, 59.5, 0.0, 0.0, 1.0), ())
PERIOD_NS = 90_000_000


def picture() -> Image:
    blocks = np.random.default_rng(4).integers(40, 220, (24, 32), np.uint8)
    return np.asarray(np.kron(blocks, np.ones((5, 5), np.uint8)), np.uint8)


def taught(blank: range = range(0), bend: float = 0.0) -> Teacher:
    """Return a teacher that was shown the way of a race car, some frames of it ``blank``."""
    (clip,) = (it for it in read_clips(str(DONKEY)) if it.also)
    teacher = Teacher(clip.camera)
    for frame in clip.frames:
        x, y, theta = clip.metric(frame).tolist()
        image = clip.image(frame)
        image = np.full_like(image, 90) if frame in blank else image
        teacher.add(image, frame * clip.period_ns, Pose(x, y, theta + bend * frame))
    return teacher


def test_a_stretch_without_features_is_bridged_by_the_odometry() -> None:
    teacher = taught(blank=range(28, 40))
    route = teacher.finish()
    assert 'an image shows too little' in teacher.notes[0]
    assert any('the odometry bridges' in note for note in teacher.notes)
    assert sum(view.bridge is not None for view in route.views) == 1
    assert route.length == pytest.approx(taught().finish().length, abs=1e-6)
    assert not teacher.further


def test_a_long_stretch_without_features_parts_the_way() -> None:
    teacher = taught(blank=range(28, 40))
    teacher._settings = TeachSettings(max_spacing=0.1)
    first = teacher.finish()
    (second,) = teacher.further
    assert first.views[-1].way < second.views[0].way
    assert first.views[-1].is_station and second.views[0].is_station
    assert any('a part of the way ends' in note for note in teacher.notes)


def test_odometry_of_another_drive_is_refused() -> None:
    with pytest.raises(DegenerateGeometryError, match='more than wheels slip'):
        taught(bend=0.04).finish()


def test_images_of_another_size_are_refused() -> None:
    with pytest.raises(ValueError, match='images must be 160x120 as the camera, got 32x24'):
        Teacher(CAMERA).add(picture()[::5, ::5], 0, Pose(0.0, 0.0, 0.0))


def test_a_robot_that_stands_where_it_stopped_has_one_station_there() -> None:
    teacher = Teacher(CAMERA)
    for k in range(80):
        teacher.add(picture(), k * PERIOD_NS, Pose(min(0.02 * k, 0.6), 0.0, 0.0))
    stands = teacher.key_views
    teacher.station()
    for k in range(80, 90):
        teacher.add(picture(), k * PERIOD_NS, Pose(0.6, 0.0, 0.0))
    teacher.station()
    assert teacher.key_views == stands


def test_without_images_there_is_no_route() -> None:
    with pytest.raises(ValueError, match='must have an image'):
        Teacher(CAMERA).finish()


def test_a_robot_that_stood_taught_no_route() -> None:
    teacher = Teacher(CAMERA)
    for k in range(60):
        teacher.add(picture(), k * PERIOD_NS, Pose(0.0, 0.0, 0.0))
    with pytest.raises(DegenerateGeometryError, match='got 0.00 m by its odometry: it stood'):
        teacher.finish()
