"""Sampling: every pixel of a strip is sampled once, and no more often than it is worth."""

import numpy as np
import pytest

from visual_servo_epipolar.core.cameras.pinhole import Camera
from visual_servo_epipolar.core.geometry.motion import DESIRED_POSE, Pose
from visual_servo_epipolar.simulation.mounts.mounting import CameraMount, FixedRig
from visual_servo_epipolar.simulation.rendering.raster import (
    _blurred_area,
    _footprint,
    _subdivisions,
    MAX_SKEW,
    PinholeView,
    rasterize,
)
from visual_servo_epipolar.simulation.rendering.sampling import (
    _areas,
    _average,
    _cover,
    _sources,
    _texel_boxes,
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
def test_a_slanted_sliver_is_cut_along_its_length_until_it_is_blurred_little(turned: bool) -> None:
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
    raster = rasterize(scene, PinholeView(320, 240, CAMERA.matrix, centre, R_world_camera))
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
def test_the_boxes_of_texels_hold_what_is_sampled(pose: Pose) -> None:
    scene, rig = room(0), FixedRig(CAMERA, CameraMount(tilt=0.1, roll=0.05))
    R_world_camera, centre = rig.camera_pose(pose)
    raster = rasterize(scene, PinholeView(320, 240, CAMERA.matrix, centre, R_world_camera))
    areas = list(_areas(raster))
    sheets, maps = _sources(scene, raster, areas)
    boxes = list(_texel_boxes(raster, areas, sheets, maps))
    whole = 0
    for area, sheet, matrix, (box, _) in zip(areas, sheets, maps, boxes, strict=True):
        strip, (rows, columns) = raster.strips[area.number - 1], sheet.shape
        width, height = np.subtract(area.box[2:], area.box[:2]) * (strip.columns, strip.rows)
        assert 0 <= box[0] < box[2] <= columns
        assert 0 <= box[1] < box[3] <= rows
        whole += box == (0, 0, columns, rows)
        x, y = np.meshgrid((0, width - 1), (0, height - 1))
        u, v, w = matrix @ [x.ravel(), y.ravel(), np.ones(4)]
        if (w <= 0.0).any():
            assert box == (0, 0, columns, rows)
            continue
        # Bilinear sampling reads the texel before and the one after.
        for at, low, high, end in ((u / w, *box[::2], columns), (v / w, *box[1::2], rows)):
            at = np.clip(at, 0.0, end - 1.0)
            assert (np.floor(at) >= low).all()
            assert (np.minimum(np.floor(at) + 1, end - 1) < high).all()
    assert whole < 0.5 * len(areas)
    assert np.mean([dense for _, dense in boxes]) > 0.5
