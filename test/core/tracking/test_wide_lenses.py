"""Wide lenses: the tracker takes on the features that a turn brings into view."""

import math

from hypothesis import given
import numpy as np
import pytest
from strategies import floats

from visual_servo_epipolar.core.cameras.equidistant import Equidistant
from visual_servo_epipolar.core.cameras.equirectangular import of_size
from visual_servo_epipolar.core.cameras.pinhole import Camera
from visual_servo_epipolar.core.geometry.motion import Pose
from visual_servo_epipolar.core.tracking.canvas import Canvas, PLANE
from visual_servo_epipolar.core.tracking.settings import TrackerSettings
from visual_servo_epipolar.core.tracking.tracker import Tracker
from visual_servo_epipolar.core.tracking.warps import Warps
from visual_servo_epipolar.core.twoview.measurement import view_margins
from visual_servo_epipolar.simulation.camera_simulator import CameraSimulator
from visual_servo_epipolar.simulation.cameras import CameraSettings

SIDE, KEPT = 600, 12  # [px]; features that a turn must leave in view
CAMERA = CameraSettings(
    scene_seed=101,
    width=SIDE,
    height=SIDE,
    focal_length=SIDE / math.radians(195.0),
    principal_u=0.5 * (SIDE - 1),
    principal_v=0.5 * (SIDE - 1),
    distortion_model='equidistant',
    image_circle=195.0,
)


def test_a_turn_through_half_a_circle_is_free_all_the_way() -> None:
    """It stayed with the features that it began with, which came to one edge, and barred it."""
    simulator, camera = CameraSimulator(CAMERA), CAMERA.nominal_camera
    tracker, free = Tracker(TrackerSettings(), camera), []
    tracker.set_desired(simulator.photograph())
    for frame in range(40):
        pose = Pose.from_start(-3.2, 0.6, -142.0 + 3.9 * frame)
        rays = camera.rays(tracker.track(simulator.capture(pose, frame)).current)
        left, _ = view_margins(rays, np.ones(len(rays), bool), camera.edges, KEPT)
        free.append(left)
    assert min(free) > 1.0


PANORAMA = of_size(320, 160)
CANVAS, BAND = Canvas.of(PANORAMA), Canvas.of(of_size(320, 100))
FISHEYE = Canvas.of(Equidistant(200, 200, 60.0, 60.0, 99.5, 99.5))


def smooth(camera) -> np.ndarray:
    """Return an image that is smooth on the sphere."""
    u, v = np.meshgrid(np.arange(camera.width), np.arange(camera.height))
    rays = camera.rays(np.column_stack([u.ravel(), v.ravel()]).astype(float))
    grey = 128.0 + 60.0 * rays[:, 0] + 40.0 * rays[:, 1] - 25.0 * rays[:, 2]
    return np.rint(grey).astype(np.uint8).reshape(camera.height, camera.width)


def warps(pixels: np.ndarray) -> Warps:
    count = len(pixels)
    return Warps(np.arange(count), pixels, pixels, np.tile(np.eye(2), (count, 1, 1)))


@pytest.mark.parametrize('canvas', [CANVAS, BAND], ids=['whole', 'band'])
def test_beyond_its_ends_it_shows_what_is_there(canvas: Canvas) -> None:
    image = smooth(canvas.camera)
    painted = canvas.painted(image)
    assert np.abs(np.diff(painted.astype(int), axis=0)).max() <= 3
    assert np.abs(np.diff(painted.astype(int), axis=1)).max() <= 3
    np.testing.assert_array_equal(canvas.image_of(painted), image)


def test_an_image_without_a_seam_is_its_own_canvas() -> None:
    image = np.zeros((200, 200), np.uint8)
    for canvas in (PLANE, FISHEYE, Canvas.of(Camera(200, 200, 100.0, 100.0, 99.5, 99.5))):
        assert canvas.painted(image) is image
        pixels = np.array([[0.0, 0.0], [199.0, 250.0]])
        assert canvas.owns(pixels).all()
        assert canvas.pixels_of_image(pixels) is pixels
        assert canvas.own(warps(pixels)).current is pixels


@given(floats(1.0, 380.0), floats(1.0, 206.0))
def test_a_feature_is_put_back_to_where_the_same_ray_is_owned(u: float, v: float) -> None:
    there = np.array([[u, v]])
    back = CANVAS.own(warps(there)).current
    assert CANVAS.owns(back).all()
    np.testing.assert_allclose(CANVAS.points(back), CANVAS.points(there), atol=1e-9)
    assert PANORAMA.contains(CANVAS.pixels_of_image(back)).all()


@given(floats(2.0, 380.0), floats(2.0, 205.0))
def test_what_is_around_a_feature_is_put_back_with_it(u: float, v: float) -> None:
    there, step = np.array([[u, v]]), np.array([[0.01, 0.02]])
    back = CANVAS.own(warps(there))
    beside = back.current + step @ back.affine[0].T
    np.testing.assert_allclose(CANVAS.points(beside), CANVAS.points(there + step), atol=1e-9)


def test_neighbours_across_the_seam_are_near() -> None:
    point = np.array([34.0, 90.0])
    near = CANVAS.beside(np.array([[350.0, 90.0], [36.0, 91.0]]), point)
    assert near.tolist() == [[30.0, 90.0], [36.0, 91.0]]
