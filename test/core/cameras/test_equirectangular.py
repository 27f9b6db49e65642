"""The panorama: every ray has a pixel, the left edge is the right one, the size alone tells it."""

from dataclasses import replace
import math

from hypothesis import given
import numpy as np
import pytest
from strategies import floats

from visual_servo_epipolar.core.cameras.equirectangular import Equirectangular, of_size
from visual_servo_epipolar.core.cameras.plausibility import doubts, refuse_implausible
from visual_servo_epipolar.core.cameras.registry import (
    calibrated_camera,
    camera_of_size,
    scaled,
    with_intrinsics,
)

CAMERA = of_size(1920, 960)


def ray(bearing: float, elevation: float) -> np.ndarray:
    """Return the ray at a ``bearing``, right, and an ``elevation``, down."""
    level = math.cos(elevation)
    return np.array([[level * math.sin(bearing), math.sin(elevation), level * math.cos(bearing)]])


@given(floats(-0.5, 1919.5), floats(0.0, 959.0))
def test_columns_go_on_at_the_other_side(u: float, v: float) -> None:
    beside = CAMERA.rays(np.array([[u, v], [u + 1920.0, v], [u - 1920.0, v]]))
    np.testing.assert_allclose(beside - beside[0], 0.0, atol=1e-12)


def test_the_middle_looks_ahead_right_is_right_and_down_is_down() -> None:
    rays = CAMERA.rays(np.array([[959.5, 479.5], [1439.5, 479.5], [959.5, 959.5], [-0.5, 479.5]]))
    ahead, right, down, behind = np.round(rays, 12).tolist()
    assert (ahead, right, down) == ([0, 0, 1], [1, 0, 0], [0, 1, 0])
    assert behind[2] == -1.0


def test_near_a_pole_a_pixel_covers_no_less() -> None:
    assert CAMERA.resolution(ray(0.0, math.pi / 2.0))[0] > 0.5 / CAMERA.focal


def test_no_turn_leads_out_of_view() -> None:
    assert CAMERA.wraps and CAMERA.wide and CAMERA.planar is None
    assert CAMERA.edges == (-math.inf, math.inf)


@pytest.mark.parametrize('k', [[0.0] * 9, [500.0, 0, 9, 0, 500.0, 9, 0, 0, 1]])
def test_the_size_alone_tells_it_whatever_k_says(k: list[float]) -> None:
    assert calibrated_camera((1920, 960), k, (), 'equirectangular') == CAMERA
    assert camera_of_size('equirectangular', (1920, 960)) == CAMERA
    refuse_implausible(CAMERA)
    assert doubts(CAMERA) == ''


def test_a_lower_image_is_cut_above_and_below() -> None:
    band = of_size(1920, 600)
    assert not band.contains(band.pixels(ray(0.5, 1.2))).any()
    np.testing.assert_allclose(band.rays(band.pixels(ray(0.5, 0.8))), ray(0.5, 0.8), atol=1e-12)


@pytest.mark.parametrize('horizon', [130.0, 299.5, 450.0])
def test_k_of_a_cut_one_says_where_the_horizon_is(horizon: float) -> None:
    k = [1920 / math.tau, 0.0, 9.0, 0.0, 1920 / math.tau, horizon, 0.0, 0.0, 1.0]
    cut = calibrated_camera((1920, 600), k, (), 'equirectangular')
    np.testing.assert_allclose(cut.rays(np.array([[959.5, horizon]])), ray(0.0, 0.0), atol=1e-12)
    assert calibrated_camera((1920, 600), cut.matrix.ravel(), (), 'equirectangular') == cut


@pytest.mark.parametrize('horizon', [600.0, -1.0])
def test_rows_beyond_a_pole_are_refused_with_what_is_needed(horizon: float) -> None:
    k = [1920 / math.tau, 0.0, 959.5, 0.0, 1920 / math.tau, horizon, 0.0, 0.0, 1.0]
    with pytest.raises(ValueError, match=r'between the poles.*set K\[5\] .* region of interest'):
        calibrated_camera((1920, 600), k, (), 'equirectangular')


@pytest.mark.parametrize('size', [(1920, 1080), (960, 960)])
def test_an_image_that_is_too_high_is_refused_in_one_sentence(size: tuple[int, int]) -> None:
    with pytest.raises(ValueError, match=r'at most half as high as wide, got (1920|960)x'):
        of_size(*size)


def test_a_part_of_it_or_a_stretched_one_is_refused() -> None:
    with pytest.raises(ValueError, match='all 360 deg over its width, got 900x400'):
        with_intrinsics(CAMERA, width=900, height=400)
    with pytest.raises(ValueError, match='neither cut nor stretched'):
        replace(CAMERA, fy=200.0)


def test_half_the_pixels_are_the_same_panorama() -> None:
    half = scaled(CAMERA, (960, 480), 0.5, 0.5)
    assert isinstance(half, Equirectangular)
    np.testing.assert_allclose(half.matrix, of_size(960, 480).matrix)


def test_a_projection_that_the_size_does_not_tell_is_refused() -> None:
    with pytest.raises(ValueError, match=r"one of camera_info, equirectangular, .*got 'equid"):
        camera_of_size('equidistant', (1920, 960))


def test_an_earlier_name_of_stitched_images_is_that_of_a_panorama() -> None:
    assert camera_of_size('equirectangular_stitched', (1920, 960)) == CAMERA
    assert calibrated_camera((1920, 960), [0.0] * 9, (), 'equirectangular_stitched') == CAMERA
