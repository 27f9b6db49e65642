"""Teaching: what cannot become a route is refused, with what to do."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from routes import key_view, route_of

from visual_servo_epipolar.core.arrays import Image
from visual_servo_epipolar.core.cameras.registry import calibrated_camera
from visual_servo_epipolar.core.errors import DegenerateGeometryError
from visual_servo_epipolar.core.geometry.motion import Pose
from visual_servo_epipolar.core.routes import teaching
from visual_servo_epipolar.core.routes.key_view_tracker import _described
from visual_servo_epipolar.core.routes.places import PlaceFinder
from visual_servo_epipolar.core.routes.route import Appearance, in_memory, RouteView
from visual_servo_epipolar.core.routes.teaching import Teacher
from visual_servo_epipolar.evaluation.benchmarks.routes import read_clips

DONKEY = Path(__file__).parents[2] / 'evaluation' / 'benchmarks' / 'donkey'
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


def test_a_long_stretch_without_features_parts_the_way(monkeypatch) -> None:
    monkeypatch.setattr(teaching, 'FARTHEST', 0.2)
    teacher = taught(blank=range(28, 40))
    first = teacher.finish()
    (second,) = teacher.further
    assert first.views[-1].way < second.views[0].way
    assert first.views[-1].is_station and second.views[0].is_station
    assert any('a part of the way ends' in note for note in teacher.notes)


def test_odometry_of_another_drive_is_refused() -> None:
    with pytest.raises(DegenerateGeometryError, match='more than wheels slip'):
        taught(bend=0.04).finish()


def test_images_of_another_size_and_none_at_all_are_refused() -> None:
    with pytest.raises(ValueError, match='images must be 160x120 as the camera, got 32x24'):
        Teacher(CAMERA).add(picture()[::5, ::5], 0, Pose(0.0, 0.0, 0.0))
    with pytest.raises(ValueError, match='must have an image'):
        Teacher(CAMERA).finish()


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


def test_a_robot_that_stood_taught_no_route() -> None:
    teacher = Teacher(CAMERA)
    for k in range(60):
        teacher.add(picture(), k * PERIOD_NS, Pose(0.0, 0.0, 0.0))
    with pytest.raises(DegenerateGeometryError, match='got 0.00 m by its odometry: it stood'):
        teacher.finish()


ROWS = np.arange(3, 9)


def lit(image: Image, side: int) -> Image:
    """Return an image by a lamp at one side."""
    fall = np.linspace(*((0.05, 1.0), (1.0, 0.05))[side % 2], image.shape[1 - side // 2])
    fall = fall if side < 2 else fall[:, None]
    return (image * fall).astype(np.uint8)


def by_lamp(view: RouteView, side: int, shift: int = 0) -> Appearance:
    """Return what a key view looks like by a lamp, moved down by some pixels."""
    keypoints = view.keypoints.take(ROWS)
    pixels = keypoints.pixels + [0.0, shift]
    image = np.roll(lit(view.image, side), shift, axis=0)
    return Appearance(in_memory(image), replace(keypoints, pixels=pixels), ROWS)


@pytest.fixture
def view() -> RouteView:
    squares = np.arange(12, dtype=np.uint8).reshape(3, 4) * 17 + 40
    image = np.kron(squares, np.ones((16, 16), np.uint8))
    return replace(key_view(1), load=in_memory(image))


def test_light_from_another_side_is_kept_once(view: RouteView) -> None:
    same = Appearance(view.load, view.keypoints.take(ROWS), ROWS)
    assert view.renewed_by(same, 3).renewed == ()
    renewed = view.renewed_by(by_lamp(view, 0), 3)
    assert len(renewed.renewed) == 1
    assert renewed.renewed_by(by_lamp(view, 0, shift=2), 3).renewed == renewed.renewed


def test_no_more_are_kept_than_asked_for_and_the_first_always(view: RouteView) -> None:
    renewed = view
    for side in (0, 1, 2, 3):
        renewed = renewed.renewed_by(by_lamp(view, side), 2)
        assert len(renewed.renewed) <= 2 and renewed.load is view.load
    assert len(renewed.renewed) == 2


def test_places_are_looked_for_in_all_photographs_of_a_key_view(view: RouteView) -> None:
    renewed = view.renewed_by(by_lamp(view, 0), 3)
    finder = PlaceFinder(route_of(key_view(0), renewed, key_view(2)))
    shown = np.concatenate([it.keypoints.descriptors for it in renewed.appearances])
    assert len(shown) == 13 + len(ROWS)
    np.testing.assert_array_equal(finder._descriptors[1], shown)


def test_descriptors_are_of_today_where_today_shows_the_keypoint() -> None:
    squares = np.random.default_rng(0).integers(0, 255, (30, 40), np.uint8)
    image = np.kron(squares, np.ones((8, 8), np.uint8))
    keypoints = key_view(1).keypoints
    described = _described(keypoints, keypoints.pixels + 100.0, image)
    same = (described.descriptors == keypoints.descriptors).all(axis=1)
    assert not same.all() and np.array_equal(described.pixels, keypoints.pixels + 100.0)
