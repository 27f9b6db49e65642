"""Images of a fisheye: where things appear on every face of the cube, and across its edges."""

import math

from durations import few_of
import numpy as np
import pytest

from visual_servo_epipolar.core.cameras.equidistant import Equidistant
from visual_servo_epipolar.core.geometry.motion import DESIRED_POSE, Pose
from visual_servo_epipolar.simulation.mounts.mounting import CameraMount, FixedRig
from visual_servo_epipolar.simulation.rendering.renderer import Renderer
from visual_servo_epipolar.simulation.rendering.surfaces import Scene, Surface, Texture
from visual_servo_epipolar.simulation.rooms.scene import room

LENS = Equidistant(960, 768, 260.0, 260.0, 480.0, 383.0, (-0.01, 0.002, 0.0, 0.0))
# Turned to either side, up and down: the wall is on another face, or on several.
TURNS = {'ahead': (0, 0), 'edge': (45, 0), 'right': (80, 0), 'left': (-80, 0), 'below': (20, -65)}
TURNS |= {'above': (-20, 65), 'corner': (45, 35), 'behind': (105, 0)}
REACH = 6


def wall(image: np.ndarray) -> Surface:
    """Return a square of paint of 4 m, 3.6 m ahead of the goal."""
    origin = np.array([-2.0, 3.6, 2.6])
    edges = np.array([4.0, 0.0, 0.0]), np.array([0.0, 0.0, -4.0])
    return Surface('wall', 'room', origin, *edges, Texture(image))


def dots() -> tuple[np.ndarray, np.ndarray]:
    """Return a picture of bright, round spots on grey, and their middles in the world, (N, 3)."""
    at = np.arange(1000.0)
    row = np.exp(-(((at + 50.0) % 100.0 - 50.0) ** 2) / (2.0 * 5.0**2))
    image = np.rint(60.0 + 180.0 * row[:, None] * row).astype(np.uint8)
    x, y = np.meshgrid(*[(np.arange(100, 1000, 100) + 0.5) / 250.0] * 2)
    return image, np.stack([x.ravel() - 2.0, np.full(x.size, 3.6), 2.6 - y.ravel()], axis=1)


def centroid(image: np.ndarray, pixel: np.ndarray) -> np.ndarray:
    """Return the centroid of what is brighter than grey 60 around a pixel."""
    u, v = np.rint(pixel).astype(int)
    patch = image[v - REACH : v + REACH + 1, u - REACH : u + REACH + 1].astype(float) - 60.0
    patch[patch < 2.0] = 0.0
    span = np.arange(-REACH, REACH + 1)
    shift = patch.sum(axis=0) @ span, patch.sum(axis=1) @ span
    return np.array([u, v]) + np.array(shift) / patch.sum()


@pytest.mark.parametrize('turn', few_of([*TURNS], keep=(1, 6)))
def test_spots_are_imaged_where_the_lens_says(turn: str) -> None:
    heading, tilt = np.radians(TURNS[turn])
    image, points = dots()
    renderer = Renderer(Scene((wall(image),)), FixedRig(LENS, CameraMount(tilt=tilt)))
    pose = Pose(0.0, 0.0, math.pi / 2.0 + heading)
    pixels, visible = renderer.project(points, pose)
    pixels = pixels[visible & LENS.contains(pixels, margin=10.0)]
    picture = renderer.render(pose)
    errors = np.array([centroid(picture, pixel) for pixel in pixels]) - pixels
    assert len(pixels) > 20
    assert np.median(np.hypot(*errors.T)) < 0.02
    assert np.hypot(*errors.T).max() < 0.06


@pytest.fixture(scope='module')
def furnished() -> Scene:
    return room(0)


def test_what_is_traced_is_projected_where_it_came_from(furnished: Scene) -> None:
    renderer = Renderer(furnished, FixedRig(LENS, CameraMount(tilt=0.05, roll=-0.08)))
    u, v = np.meshgrid(np.linspace(1.0, 958.0, 25), np.linspace(1.0, 766.0, 19))
    pixels = np.stack([u.ravel(), v.ravel()], axis=1)
    rays = LENS.rays(pixels)
    seen = np.isfinite(rays).all(axis=1)
    points = renderer.trace(pixels[seen], DESIRED_POSE)
    hit = np.isfinite(points).all(axis=1)
    back, visible = renderer.project(points[hit], DESIRED_POSE)
    assert hit.mean() > 0.9
    assert visible.all()
    assert (rays[seen][hit][:, 2] < 0.0).sum() > 20
    np.testing.assert_allclose(back, pixels[seen][hit], atol=1e-6)


def test_the_room_fills_the_image_without_seams(furnished: Scene) -> None:
    image = Renderer(furnished, FixedRig(LENS)).render(DESIRED_POSE)
    assert (image > 0).mean() > 0.99
    # A seam would be a line of pixels that are unlike both neighbours.
    grid = np.stack(np.meshgrid(np.arange(960.0), np.arange(768.0)), axis=-1)
    rays = LENS.rays(grid.reshape(-1, 2))
    face = np.argmax(np.abs(rays), axis=1).reshape(768, 960)
    step = np.abs(np.diff(image.astype(float), axis=1))
    across = face[:, 1:] != face[:, :-1]
    assert np.median(step[across]) <= np.median(step[~across]) + 2.0


def test_a_lens_that_sees_a_part_alone_is_black_beyond(furnished: Scene) -> None:
    folding = Equidistant(960, 768, 300.0, 300.0, 480.0, 383.0, (-0.12, 0.0, 0.0, 0.0))
    image = Renderer(furnished, FixedRig(folding)).render(DESIRED_POSE)
    assert image[383, 480] > 0
    assert image[0, 0] == 0
