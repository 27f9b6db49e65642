"""Sampling: every pixel of a strip is sampled once, and no more often than it is worth."""

import numpy as np
import pytest

from visual_servo_epipolar.core.geometry.camera import Camera
from visual_servo_epipolar.core.geometry.motion import DESIRED_POSE, Pose
from visual_servo_epipolar.simulation.mounts.fixed import FixedRig
from visual_servo_epipolar.simulation.mounts.mounting import CameraMount
from visual_servo_epipolar.simulation.rendering.raster import rasterize, View
from visual_servo_epipolar.simulation.rendering.sampling import (
    _areas,
    _average,
    _cache_lines,
    _cover,
    _sources,
    CACHE_LINE,
)
from visual_servo_epipolar.simulation.rendering.strips import (
    _blurred_area,
    _footprint,
    _subdivisions,
    MAX_SKEW,
)
from visual_servo_epipolar.simulation.rendering.surfaces import SHARPEST
from visual_servo_epipolar.simulation.rooms.scene import room

CAMERA = Camera(320, 240, 192.0, 192.0, 159.5, 119.5)
ANGLE = 0.7  # of a long pixel on the texture [rad]


def long_pixel(length: float, breadth: float) -> tuple[np.ndarray, np.ndarray]:
    """Return slopes, (1, 2, 2), of a pixel that is long, slanted on the texture, and its area."""
    along = np.array([np.cos(ANGLE), np.sin(ANGLE)])
    slopes = np.stack([breadth * np.array([-along[1], along[0]]), length * along], axis=1)
    return slopes[None], np.array([length * breadth])


@pytest.mark.parametrize('turned', (False, True))
def test_a_slanted_sliver_is_cut_along_its_length_until_it_is_blurred_little(
    turned: bool,
) -> None:
    slopes, area = long_pixel(16.0, 2.0)
    slopes = slopes[:, :, ::-1] if turned else slopes
    columns, rows = _subdivisions(slopes, area)
    assert (columns[0], rows[0]) == ((3, 1) if turned else (1, 3))
    blurred = _blurred_area(_footprint(slopes, columns, rows)) * columns * rows
    assert blurred[0] < 1.1 * MAX_SKEW * area[0]


@pytest.mark.parametrize('length', (0.5, 1.0, SHARPEST))
def test_a_pixel_on_a_magnified_texture_stays_whole(length: float) -> None:
    columns, rows = _subdivisions(*long_pixel(length, length / 8.0))
    assert (columns[0], rows[0]) == (1, 1)


@pytest.mark.parametrize('waste', (0, 30, 400))
def test_a_cover_holds_a_mask_once_and_little_beside(waste: int) -> None:
    rng = np.random.default_rng(waste)
    mask = (rng.random((12, 17)) < 0.03).astype(np.uint8)
    mask = np.kron(mask, np.ones((6, 5), np.uint8))
    times = np.zeros(mask.shape, int)
    for (left, top, right, bottom), full in _cover(mask, waste):
        part = mask[top:bottom, left:right]
        times[top:bottom, left:right] += 1
        assert (part == 0).sum() <= waste
        assert full == part.all()
    assert times.max() == 1
    assert times[mask > 0].all()


def test_an_empty_mask_needs_no_cover() -> None:
    assert not list(_cover(np.zeros((5, 7), np.uint8), 0))


@pytest.mark.parametrize('pose', (DESIRED_POSE, Pose(0.7, -3.0, 1.2)))
def test_the_areas_show_each_pixel_of_each_strip_once(pose: Pose) -> None:
    scene, rig = room(0), FixedRig(CAMERA, CameraMount(tilt=0.1, roll=0.05))
    R_world_camera, centre = rig.camera_pose(pose)
    raster = rasterize(scene, View(320, 240, CAMERA.matrix, centre, R_world_camera))
    painted = np.zeros_like(raster.ids)
    for number, (left, top, right, bottom), mask in _areas(raster):
        shown = np.ones((bottom - top, right - left), bool) if mask is None else mask > 0
        assert not painted[top:bottom, left:right][shown].any()
        painted[top:bottom, left:right][shown] = number
    np.testing.assert_array_equal(painted, raster.ids)


@pytest.mark.parametrize(('columns', 'rows'), [(1, 2), (1, 4), (1, 8), (2, 1), (8, 1), (2, 4)])
def test_the_mean_of_the_parts_is_rounded_once(columns: int, rows: int) -> None:
    parts = np.random.default_rng(0).integers(0, 256, (7 * rows, 13 * columns), dtype=np.uint8)
    mean = np.zeros((7, 20), np.uint8)
    _average(parts, mean[:, 3:16])  # in place, in a part of a row
    exact = parts.reshape(7, rows, 13, columns).mean(axis=(1, 3))
    assert np.abs(mean[:, 3:16] - exact).max() <= 0.5
    assert not mean[:, :3].any()
    assert not mean[:, 16:].any()


@pytest.mark.parametrize('pose', (DESIRED_POSE, Pose(0.7, -3.0, 1.2)))
def test_the_lines_read_ahead_hold_what_is_sampled(pose: Pose) -> None:
    scene, rig = room(0), FixedRig(CAMERA, CameraMount(tilt=0.1, roll=0.05))
    R_world_camera, centre = rig.camera_pose(pose)
    raster = rasterize(scene, View(320, 240, CAMERA.matrix, centre, R_world_camera))
    areas = list(_areas(raster))
    pictures, maps = _sources(scene, raster, areas)
    lines = _cache_lines(raster, areas, pictures, maps)
    for area, matrix, ahead in zip(areas, maps, lines, strict=True):
        strip, picture = raster.strips[area.number - 1], pictures[area.number - 1]
        width, height = np.subtract(area.box[2:], area.box[:2]) * (strip.columns, strip.rows)
        x, y, w = matrix @ [(width - 1) // 2, (height - 1) // 2, 1.0]
        column, row = np.clip((x / w, y / w), 0, np.array(picture.shape[::-1]) - 1).astype(int)
        start = ahead.__array_interface__['data'][0] - picture.__array_interface__['data'][0]
        top, left = divmod(start, picture.shape[1])
        assert not ahead.size or top <= row < top + len(ahead)
        assert not ahead.size or left <= column < left + CACHE_LINE * ahead.shape[1]
    assert np.mean([line.size > 0 for line in lines]) > 0.5
