"""Two fisheyes in one image: every ray has a pixel, of the lens that looks its way."""

from hypothesis import given
import numpy as np
import pytest
from strategies import floats

from visual_servo_epipolar.core.cameras.dual_fisheye import LAYOUTS
from visual_servo_epipolar.core.cameras.equidistant import Equidistant
from visual_servo_epipolar.core.cameras.plausibility import doubts, refuse_implausible
from visual_servo_epipolar.core.cameras.registry import (
    calibrated_camera,
    camera_of_size,
    scaled,
    with_intrinsics,
)

SIZE = 640, 320
LENS = Equidistant(320, 320, 320 / np.pi, 320 / np.pi, 159.5, 159.5)
AHEAD, RIGHT_DOWN = np.array([[0.0, 0.0, 1.0]]), np.array([[0.6, 0.48, 0.64]])
BEHIND = np.array([[-1.0, 1.0, -1.0]])


@pytest.fixture(params=LAYOUTS)
def camera(request):
    return camera_of_size(request.param, SIZE)


@pytest.mark.parametrize('name', LAYOUTS)
@given(x=floats(-1.0, 1.0), y=floats(-1.0, 1.0), z=floats(-1.0, 1.0))
def test_a_ray_is_imaged_where_it_comes_back_from(name, x, y, z) -> None:
    camera = camera_of_size(name, SIZE)
    ray = np.array([[x, y, z]]) / max(np.sqrt(x * x + y * y + z * z), 1e-9)
    if abs(np.linalg.norm(ray) - 1.0) < 1e-6:
        pixel = camera.pixels(ray)
        assert camera.contains(pixel, margin=-0.5).all() and camera.round_trips(pixel, ray).all()
        np.testing.assert_allclose(camera.rays(pixel), ray, atol=1e-7)


def test_upright_ahead_is_to_the_left_as_one_fisheye_shows_it() -> None:
    camera = camera_of_size('dual_fisheye', SIZE)
    np.testing.assert_allclose(camera.pixels(RIGHT_DOWN), LENS.pixels(RIGHT_DOWN))
    back = camera.pixels(RIGHT_DOWN * BEHIND)
    np.testing.assert_allclose(back - [[320.0, 0.0]], LENS.pixels(RIGHT_DOWN))


def test_the_driver_has_ahead_to_the_right_and_both_on_their_sides() -> None:
    camera = camera_of_size('dual_fisheye_insta360', SIZE)
    (u, v), (along, across) = LENS.pixels(RIGHT_DOWN)[0], camera.pixels(RIGHT_DOWN)[0]
    assert (along, across) == pytest.approx((320 + 319 - v, u))
    assert camera.pixels(RIGHT_DOWN * BEHIND)[0] == pytest.approx((v, 319 - u))


def test_what_a_lens_sees_beyond_its_half_has_the_ray_of_that_lens(camera) -> None:
    corner = camera.pixels(AHEAD) + [[-115.0, -115.0]]
    ray = camera.rays(corner)
    assert ray[0, 2] < 0.0 and camera.round_trips(corner, ray).all()


def test_it_is_no_pinhole_and_nothing_is_odd_about_it(camera) -> None:
    assert camera.planar is None and camera.wide and not camera.wraps
    refuse_implausible(camera)
    assert doubts(camera) == ''
    assert (camera.resolution(AHEAD) == camera.resolution(AHEAD * BEHIND)).all()


def test_camera_info_tells_it_with_k_and_without(camera) -> None:
    name, k = camera.distortion_model, camera.matrix.ravel()
    assert calibrated_camera(SIZE, k, (), name) == camera
    assert calibrated_camera(SIZE, [0.0] * 9, (), name) == camera
    lens = calibrated_camera(SIZE, k, (0.01, 0.0, 0.0, 0.0), name)
    assert lens.distortion == (0.01, 0.0, 0.0, 0.0)
    assert with_intrinsics(camera) == camera
    half = scaled(camera, (320, 160), 0.5, 0.5)
    np.testing.assert_allclose(half.matrix, camera_of_size(name, (320, 160)).matrix)


@pytest.mark.parametrize('size', [(640, 480), (320, 320)])
def test_what_is_no_pair_of_squares_is_refused_in_one_sentence(size) -> None:
    with pytest.raises(ValueError, match=r'twice as wide as high, got (640|320)x'):
        camera_of_size('dual_fisheye', size)
