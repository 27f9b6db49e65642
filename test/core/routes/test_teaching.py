"""Teaching: what cannot become a route is refused, with what to do."""

import numpy as np
import pytest

from visual_servo_epipolar.core.arrays import Image
from visual_servo_epipolar.core.cameras.registry import calibrated_camera
from visual_servo_epipolar.core.errors import DegenerateGeometryError
from visual_servo_epipolar.core.geometry.motion import Pose
from visual_servo_epipolar.core.routes.teaching import Teacher

SIZE = (160, 120)
CAMERA = calibrated_camera(SIZE, (100.0, 0.0, 79.5, 0.0, 100.0, 59.5, 0.0, 0.0, 1.0), ())
PERIOD_NS = 90_000_000


def picture() -> Image:
    blocks = np.random.default_rng(4).integers(40, 220, (24, 32), np.uint8)
    return np.asarray(np.kron(blocks, np.ones((5, 5), np.uint8)), np.uint8)


def test_a_turn_on_the_spot_is_refused() -> None:
    teacher = Teacher(CAMERA)
    with pytest.raises(DegenerateGeometryError, match='turns on the spot after 0.00 m'):
        for k in range(20):
            teacher.add(picture(), k * PERIOD_NS, Pose(0.0, 0.0, 0.05 * k))


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
