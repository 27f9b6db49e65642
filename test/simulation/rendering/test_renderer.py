"""The renderer: where things appear, to a hundredth of a pixel, also on faces of a fisheye."""

from dataclasses import replace
import math

import cv2
from durations import few_of
import numpy as np
import pytest

from visual_servo_epipolar.core.cameras.equidistant import Equidistant
from visual_servo_epipolar.core.cameras.pinhole import Camera
from visual_servo_epipolar.core.geometry.motion import DESIRED_POSE, Pose
from visual_servo_epipolar.simulation.rendering.raster import (
    draw_textures,
    PinholeView,
    rasterize,
    smooth_edges,
)
from visual_servo_epipolar.simulation.rendering.renderer import Renderer
from visual_servo_epipolar.simulation.rendering.surfaces import Scene, Surface, Texture
from visual_servo_epipolar.simulation.rigs import CameraMount, SimulatedRig
from visual_servo_epipolar.simulation.rooms.scene import room

CAMERA = Camera(640, 480, 385.0, 385.0, 317.5, 240.0)
LENS = Camera(640, 480, 385.0, 385.0, 317.5, 240.0, (-0.2, 0.05, 0.001, -0.001))
POSES = (
    DESIRED_POSE,
    Pose(0.63, -1.21, math.radians(97.0)),
    Pose(-1.2, -4.0, math.radians(65.0)),
    Pose(0.3, 0.9, math.radians(111.0)),
    Pose(0.3, -10.0, math.radians(90.0)),
)
TURNED = CameraMount(tilt=0.05, roll=-0.08)
FISHEYE = Equidistant(960, 768, 260.0, 260.0, 480.0, 383.0, (-0.01, 0.002, 0.0, 0.0))
# Turned to either side, up and down: the wall is on another face, or on several.
TURNS = {'ahead': (0, 0), 'edge': (45, 0), 'right': (80, 0), 'left': (-80, 0), 'below': (20, -65)}
TURNS |= {'above': (-20, 65), 'corner': (45, 35), 'behind': (105, 0)}


def wall(image: np.ndarray, y: float, *, name: str = 'wall', half: float = 2.0) -> Surface:
    """Return a square of paint facing the goal, ``y`` ahead of it, its middle 0.6 m high."""
    origin = np.array([-half, y, 0.6 + half])
    edges = np.array([2.0 * half, 0.0, 0.0]), np.array([0.0, 0.0, -2.0 * half])
    return Surface(name, 'room' if name == 'wall' else name, origin, *edges, Texture(image))


def dots(*, spacing: int = 100, size: int = 1000, sigma: float = 2.5) -> np.ndarray:
    """Return a picture of bright, round spots on grey, centred on (spacing k, spacing l)."""
    at = np.arange(float(size))
    near = (at + spacing / 2.0) % spacing - spacing / 2.0
    row = np.exp(-(near**2) / (2.0 * sigma**2))
    return np.rint(60.0 + 180.0 * row[:, None] * row).astype(np.uint8)


def dot_points(y: float, *, spacing: int = 100, size: int = 1000, half: float = 2.0) -> np.ndarray:
    """Return the middles of the spots in the world, shape (N, 3)."""
    share = (np.arange(spacing, size, spacing) + 0.5) / size
    x, z = np.meshgrid(-half + 2.0 * half * share, 0.6 + half - 2.0 * half * share)
    return np.stack([x.ravel(), np.full(x.size, y), z.ravel()], axis=1)


def centroids(image: np.ndarray, pixels: np.ndarray, reach: int = 7) -> np.ndarray:
    """Return the centroid of what is brighter than grey 60 around each pixel, shape (N, 2)."""
    middles = []
    for u, v in np.rint(pixels).astype(int):
        patch = image[v - reach : v + reach + 1, u - reach : u + reach + 1].astype(float) - 60.0
        patch[patch < 2.0] = 0.0
        span = np.arange(-reach, reach + 1)
        shift = (patch * span).sum(), (patch * span[:, None]).sum()
        middles.append(np.array([u, v]) + np.array(shift) / patch.sum())
    return np.array(middles)


@pytest.fixture(scope='module')
def furnished() -> Renderer:
    return Renderer(room(0), SimulatedRig(CAMERA))


def test_axes_are_right_down_and_ahead() -> None:
    renderer = Renderer(Scene((wall(dots(), 4.0),)), SimulatedRig(CAMERA))
    points = np.array([[0.0, 4.0, 0.6], [1.0, 4.0, 0.6], [0.0, 4.0, 0.1], [0.0, -1.0, 0.6]])
    pixels, visible = renderer.project(points, DESIRED_POSE)
    np.testing.assert_allclose(
        pixels[:3], [[317.5, 240.0], [317.5 + 96.25, 240.0], [317.5, 240.0 + 48.125]], atol=1e-9
    )
    assert visible.tolist() == [True, True, True, False]


def test_looking_down_lifts_the_image_and_a_clockwise_roll_turns_it_back() -> None:
    scene, right = Scene((wall(dots(), 4.0),)), np.array([[1.0, 4.0, 0.6]])
    level, tilted, rolled = (
        Renderer(scene, SimulatedRig(CAMERA, mount)).project(right, DESIRED_POSE)[0]
        for mount in (CameraMount(), CameraMount(tilt=0.1), CameraMount(roll=0.1))
    )
    assert tilted[0, 1] < level[0, 1] - 30.0
    assert rolled[0, 1] < level[0, 1] - 5.0


@pytest.mark.parametrize('camera', (CAMERA, LENS))
@pytest.mark.parametrize('pose', POSES)
def test_traced_points_project_to_their_pixels(camera: Camera, pose: Pose) -> None:
    renderer = Renderer(Scene((wall(dots(), 4.0, half=20.0),)), SimulatedRig(camera, TURNED))
    u, v = np.meshgrid(np.linspace(5.0, 630.0, 9), np.linspace(5.0, 470.0, 7))
    pixels = np.stack([u.ravel(), v.ravel()], axis=1)
    points = renderer.trace(pixels, pose)
    on_surface = np.isfinite(points).all(axis=1)
    back, visible = renderer.project(points[on_surface], pose)
    assert on_surface.sum() > 20
    assert visible.all()
    np.testing.assert_allclose(back, pixels[on_surface], atol=1e-5)


@pytest.mark.parametrize('camera', (CAMERA, LENS), ids=('pinhole', 'lens'))
@pytest.mark.parametrize('pose', POSES[:4])
def test_spots_are_imaged_where_the_pinhole_model_says(camera: Camera, pose: Pose) -> None:
    # A spot of 1 cm is at most a fiftieth of a pixel off its middle's image by perspective.
    renderer = Renderer(Scene((wall(dots(), 3.6),)), SimulatedRig(camera, TURNED))
    image = renderer.render(pose)
    pixels, visible = renderer.project(dot_points(3.6), pose)
    pixels = pixels[visible & camera.contains(pixels, margin=10.0)]
    errors = centroids(image, pixels) - pixels
    assert len(pixels) > 15
    assert np.abs(errors.mean(axis=0)).max() < 0.01
    # The lens is applied to an image already sampled: a little is lost for the farthest spots.
    assert np.median(np.hypot(*errors.T)) < (0.03 if camera.distorts else 0.02)
    assert np.hypot(*errors.T).max() < (0.1 if camera.distorts else 0.06)


@pytest.mark.parametrize('pose', POSES[:2])
def test_the_edges_of_a_surface_lie_between_pixels(pose: Pose) -> None:
    dark, bright = np.full((64, 64), 40, np.uint8), np.full((64, 64), 240, np.uint8)
    scene = Scene((wall(dark, 5.0, half=30.0), wall(bright, 3.0, name='panel', half=0.5)))
    renderer = Renderer(scene, SimulatedRig(CAMERA, TURNED))
    image = renderer.render(pose).astype(float)
    corners, _ = renderer.project(scene.corners[1], pose)
    after = np.roll(corners, -1, axis=0)
    area = 0.5 * (corners[:, 0] * after[:, 1] - corners[:, 1] * after[:, 0]).sum()
    covered = (image - 40.0) / 200.0
    v, u = np.mgrid[: CAMERA.height, : CAMERA.width]
    perimeter = np.hypot(*(after - corners).T).sum()
    assert abs(covered.sum() - area) < 0.02 * perimeter
    weights = corners[:, 0] * after[:, 1] - corners[:, 1] * after[:, 0]
    middle = ((corners + after) * weights[:, None]).sum(axis=0) / (6.0 * area)
    assert (covered * u).sum() / covered.sum() == pytest.approx(middle[0], abs=0.02)
    assert (covered * v).sum() / covered.sum() == pytest.approx(middle[1], abs=0.02)


def test_paint_too_fine_to_see_is_grey() -> None:
    noise = np.random.default_rng(0).integers(0, 256, (4000, 1000), dtype=np.uint8)
    renderer = Renderer(Scene((wall(noise, 8.0, half=1.0),)), SimulatedRig(CAMERA))
    image = renderer.render(Pose(0.0, -8.0, math.pi / 2.0))
    assert image[225:255, 305:330].std() < 15.0


def test_a_surface_may_fill_a_single_pixel(furnished: Renderer) -> None:
    axes, centre = furnished.rig.camera_pose(POSES[0])
    view = PinholeView(640, 480, CAMERA.matrix, centre, axes)
    raster = rasterize(furnished.scene, view)
    single = replace(raster, boxes=((320, 240, 321, 241),) * len(raster.boxes))
    image = np.zeros((480, 640), np.uint8)
    draw_textures(furnished.scene, single, image)
    smooth_edges(furnished.scene, view, single, image)
    assert image[240, 320] == pytest.approx(furnished.render(POSES[0])[240, 320], abs=1)


@pytest.mark.parametrize('pose', POSES)
def test_the_room_fills_the_image(furnished: Renderer, pose: Pose) -> None:
    assert (furnished.render(pose) > 0).all()


def test_a_lens_that_cannot_be_undone_everywhere_is_drawn() -> None:
    # OpenCV 4.6 has no ray for a fifth of its pixels.
    lens = Camera(64, 48, 40.0, 40.0, 31.25, 23.5, (0.1,) * 8, 'rational_polynomial')
    image = Renderer(room(0), SimulatedRig(lens)).render(DESIRED_POSE)
    assert image.shape == (48, 64)
    assert image[24, 32] > 0


def test_the_same_inputs_give_the_same_bits_on_any_number_of_threads(furnished: Renderer) -> None:
    threads, images = cv2.getNumThreads(), []
    try:
        for count in (1, 2, 4):
            cv2.setNumThreads(count)
            images += [furnished.render(POSES[1]), furnished.render(POSES[1])]
    finally:
        cv2.setNumThreads(threads)
    for image in images[1:]:
        np.testing.assert_array_equal(image, images[0])


def test_a_small_step_changes_little(furnished: Renderer) -> None:
    before = furnished.render(POSES[1]).astype(int)
    after = furnished.render(Pose(0.63, -1.21 + 1e-5, math.radians(97.0))).astype(int)
    assert np.mean(np.abs(after - before) > 8) < 1e-4


@pytest.mark.parametrize('turn', few_of([*TURNS], keep=(1, 6)))
def test_spots_are_imaged_where_the_lens_says(turn: str) -> None:
    heading, tilt = np.radians(TURNS[turn])
    scene = Scene((wall(dots(sigma=5.0), 3.6),))
    renderer = Renderer(scene, SimulatedRig(FISHEYE, CameraMount(tilt=tilt)))
    pose = Pose(0.0, 0.0, math.pi / 2.0 + heading)
    pixels, visible = renderer.project(dot_points(3.6), pose)
    pixels = pixels[visible & FISHEYE.contains(pixels, margin=10.0)]
    errors = centroids(renderer.render(pose), pixels, reach=6) - pixels
    assert len(pixels) > 20
    assert np.median(np.hypot(*errors.T)) < 0.02
    assert np.hypot(*errors.T).max() < 0.06


def test_what_a_fisheye_traces_is_projected_where_it_came_from(furnished: Renderer) -> None:
    renderer = Renderer(furnished.scene, SimulatedRig(FISHEYE, CameraMount(tilt=0.05, roll=-0.08)))
    u, v = np.meshgrid(np.linspace(1.0, 958.0, 25), np.linspace(1.0, 766.0, 19))
    pixels = np.stack([u.ravel(), v.ravel()], axis=1)
    rays = FISHEYE.rays(pixels)
    seen = np.isfinite(rays).all(axis=1)
    points = renderer.trace(pixels[seen], DESIRED_POSE)
    hit = np.isfinite(points).all(axis=1)
    back, visible = renderer.project(points[hit], DESIRED_POSE)
    assert hit.mean() > 0.9
    assert visible.all()
    assert (rays[seen][hit][:, 2] < 0.0).sum() > 20
    np.testing.assert_allclose(back, pixels[seen][hit], atol=1e-6)


def test_the_room_fills_the_image_of_a_fisheye_without_seams(furnished: Renderer) -> None:
    image = Renderer(furnished.scene, SimulatedRig(FISHEYE)).render(DESIRED_POSE)
    assert (image > 0).mean() > 0.99
    # A seam would be a line of pixels that are unlike both neighbours.
    grid = np.stack(np.meshgrid(np.arange(960.0), np.arange(768.0)), axis=-1)
    rays = FISHEYE.rays(grid.reshape(-1, 2))
    face = np.argmax(np.abs(rays), axis=1).reshape(768, 960)
    step = np.abs(np.diff(image.astype(float), axis=1))
    across = face[:, 1:] != face[:, :-1]
    assert np.median(step[across]) <= np.median(step[~across]) + 2.0


def test_a_lens_that_sees_a_part_alone_is_black_beyond(furnished: Renderer) -> None:
    folding = Equidistant(960, 768, 300.0, 300.0, 480.0, 383.0, (-0.12, 0.0, 0.0, 0.0))
    image = Renderer(furnished.scene, SimulatedRig(folding)).render(DESIRED_POSE)
    assert image[383, 480] > 0
    assert image[0, 0] == 0
