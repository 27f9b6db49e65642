"""The pinhole with distortion: projection and back-projection are inverse, a bad K is refused."""

from dataclasses import replace
import math
from typing import Any

import cv2
from hypothesis import assume, given
from hypothesis import strategies as st
import numpy as np
import pytest
from strategies import floats

from visual_servo_epipolar.core.cameras.equidistant import Equidistant
from visual_servo_epipolar.core.cameras.equirectangular import of_size
from visual_servo_epipolar.core.cameras.model import CameraModel
from visual_servo_epipolar.core.cameras.pinhole import Camera

PINHOLE = {'width': 1280, 'height': 1024, 'fx': 769.0, 'fy': 771.0, 'cx': 635.0, 'cy': 512.0}
RATIONAL, PRISMS = (0.4, 0.1, 5e-4, -3e-4, 0.01, 0.7, 0.2, 0.02), (1e-3, -2e-4, 5e-4, 1e-4)
RATIONAL_NAME = 'rational_polynomial'
CAMERAS = {
    'pinhole': Camera(**PINHOLE),
    'plumb_bob of 4': Camera(**PINHOLE, distortion=(-0.25, 0.08, 1e-3, -5e-4)),
    'plumb_bob of 5': Camera(**PINHOLE, distortion=(-0.25, 0.08, 1e-3, -5e-4, -0.01)),
    **{
        name: Camera(**PINHOLE, distortion=(*RATIONAL, *more), distortion_model=RATIONAL_NAME)
        for name, more in (
            ('rational_polynomial', ()),
            ('with thin prisms', PRISMS),
            ('with a tilted sensor', (*PRISMS, 0.01, -0.02)),
        )
    },
}
CAMERAS |= {
    f'{name}, skewed': replace(camera, skew=skew)
    for name, camera in CAMERAS.items()
    for skew in (4.0, -37.0)
}


@pytest.mark.parametrize('name', CAMERAS)
@given(point=st.tuples(floats(-0.8, 0.8), floats(-0.6, 0.6)))
def test_k_is_applied_whole_after_the_distortion(name: str, point: tuple[float, float]) -> None:
    camera = CAMERAS[name]
    plain = replace(camera, width=2, height=2, fx=1.0, fy=1.0, cx=0.0, cy=0.0, skew=0.0)
    distorted = plain.pixels_of(np.array([point]))[0]
    u, v, _ = camera.matrix @ [*distorted, 1.0]
    np.testing.assert_allclose(camera.pixels_of(np.array([point])), [[u, v]], atol=1e-9)


def test_the_image_ends_at_its_last_pixel_less_the_margin() -> None:
    pixels = np.array([[0.0, 0.0], [1279.0, 1023.0], [1279.1, 5.0], [-0.1, 5.0], [9.9, 50.0]])
    camera = CAMERAS['pinhole']
    assert camera.contains(pixels).tolist() == [True, True, False, False, True]
    assert camera.contains(pixels, margin=10.0).tolist() == [False] * 5


@pytest.mark.parametrize(
    ('kind', 'change', 'message'),
    [
        (Camera, {'fx': 0.0}, r'focal lengths must be positive.*K\[0\] = 0.*calibrate'),
        (Camera, {'fy': -769.0}, 'focal lengths must be positive'),
        (Camera, {'cx': np.nan}, 'intrinsics must be finite.*nan'),
        (Camera, {'fx': np.inf}, 'intrinsics must be finite.*inf'),
        (Camera, {'distortion': (np.nan, 0.0, 0.0, 0.0)}, 'intrinsics must be finite'),
        (Equidistant, {'cy': np.nan}, 'intrinsics must be finite'),
        (Camera, {'width': 0}, 'image size must be positive, got 0x1024'),
        (Camera, {'height': -1}, 'image size must be positive, got 1280x-1'),
        (Camera, {'distortion': (0.1,) * 3}, r"distortion must be .*got\s+'plumb_bob' with 3"),
        (Camera, {'distortion': (0.1,) * 8}, "'plumb_bob' with 8; rectify"),
        (Camera, {'distortion': (0.1,) * 5, 'distortion_model': RATIONAL_NAME}, 'al. with 5'),
        (Camera, {'distortion_model': 'equidistant'}, "'equidistant' with 0; rectify"),
        (Equidistant, {'distortion': (0.1,) * 5}, 'must have 4 coefficients, got 5'),
    ],
)
def test_a_camera_that_cannot_be_is_refused(kind, change: dict[str, Any], message: str) -> None:
    with pytest.raises(ValueError, match=message):
        kind(**(PINHOLE | change))


@pytest.mark.parametrize('shape', [(2,), (3, 3), (4, 1, 2)])
def test_points_of_another_shape_are_refused(shape: tuple[int, ...]) -> None:
    camera = CAMERAS['pinhole']
    with pytest.raises(ValueError, match=r'pixels must have shape \(N, 2\), got'):
        camera.image_points(np.zeros(shape))
    with pytest.raises(ValueError, match=r'points must have shape \(N, 2\), got'):
        camera.pixels_of(np.zeros(shape))


def test_a_pixel_that_is_not_a_number_is_refused() -> None:
    with pytest.raises(ValueError, match='pixels must be finite, got 1 rows'):
        CAMERAS['plumb_bob of 4'].image_points(np.array([[1.0, 2.0], [np.nan, 3.0]]))


def test_what_is_behind_is_not_in_the_image() -> None:
    pixels = CAMERAS['pinhole'].pixels(np.array([[0.0, 0.0, -1.0], [0.0, 0.0, 1.0]]))
    assert np.isnan(pixels[0]).all()
    assert pixels[1].tolist() == [635.0, 512.0]


def test_pixels_beyond_the_fold_of_the_distortion_do_not_come_back() -> None:
    camera = Camera(**PINHOLE, distortion=(-0.45, 0.0, 0.0, 0.0))
    # r (1 - 0.45 r^2) grows up to r = 0.861, where it is 0.574.
    ends = np.array([[635.0 + 0.57 * 769.0, 512.0], [635.0 + 0.58 * 769.0, 512.0]])
    rays = camera.rays(ends)
    assert camera.round_trips(ends, rays).tolist() == [True, False]
    beyond = np.array([[1.2, 0.0, 1.0]]) / np.hypot(1.2, 1.0)  # imaged within, by the fold
    assert not camera.round_trips(camera.pixels(beyond), beyond).any()


CENTRE = {'cx': 640.0, 'cy': 511.0}
LENSES = {
    'ideal, 180 deg': Equidistant(1280, 1024, 407.4, 408.1, **CENTRE),
    'ideal, 300 deg': Equidistant(1280, 1024, 200.0, 200.0, **CENTRE),
    'of a calibration': Equidistant(
        1280, 1024, 396.0, 396.5, **CENTRE, distortion=(-0.012, 0.004, -0.0015, 0.0002)
    ),
    'that folds': Equidistant(
        1280, 1024, 480.0, 480.0, **CENTRE, distortion=(-0.1, 0.0, 0.0, 0.0)
    ),
}
LENSES |= {f'{name}, skewed': replace(lens, skew=-20.0) for name, lens in LENSES.items()}
WIDE = Equidistant(1280, 1024, 1280.0 / math.radians(185.0), 396.0, 639.5, 511.5)
NUMBERS = st.floats(0.0, 1.0)


def ray(theta: float, turn: float) -> np.ndarray:
    """Return the ray at ``theta`` from the axis, ``turn`` about it."""
    sine = math.sin(theta)
    return np.array([[sine * math.cos(turn), sine * math.sin(turn), math.cos(theta)]])


@pytest.mark.parametrize('name', LENSES)
@given(share=NUMBERS, turn=floats(-math.pi, math.pi))
def test_a_ray_is_imaged_where_it_comes_back_from(name: str, share: float, turn: float) -> None:
    camera = LENSES[name]
    seen = ray(0.999 * share * camera.reach, turn)
    pixels = camera.pixels(seen)
    np.testing.assert_allclose(camera.rays(pixels), seen, atol=1e-11)
    assert camera.round_trips(pixels, camera.rays(pixels)).all()


EVERY = CAMERAS | LENSES | {'panorama': of_size(1280, 640)}


def pixel_of(camera: CameraModel, u: float, v: float) -> np.ndarray:
    """Return the pixel at shares of width and height."""
    return np.array([[u * (camera.width - 1), v * (camera.height - 1)]])


@pytest.mark.parametrize('name', EVERY)
@given(u=NUMBERS, v=NUMBERS)
def test_a_pixel_comes_back_or_has_no_ray(name: str, u: float, v: float) -> None:
    camera = EVERY[name]
    pixel = pixel_of(camera, u, v)
    rays = camera.rays(pixel)
    if name in LENSES and np.isnan(rays).any():
        assert not camera.round_trips(pixel, rays).any()
    else:
        assert np.linalg.norm(rays) == pytest.approx(1.0, abs=1e-12)
        assert camera.round_trips(pixel, rays).all() and camera.contains(pixel).all()
        # A thousandth of the tracking error, up to the corners, where the iteration is slowest.
        tolerance = 5e-5 if name in CAMERAS else 1e-8
        np.testing.assert_allclose(camera.pixels(rays), pixel, atol=tolerance)


@pytest.mark.parametrize('name', EVERY)
@given(u=floats(0.1, 0.9), v=floats(0.1, 0.9))
def test_the_resolution_is_the_root_of_the_solid_angle_of_a_pixel(name, u, v) -> None:
    camera, step = EVERY[name], 0.02
    sides = [[0.0, 0.0], [step, 0.0], [-step, 0.0], [0.0, step], [0.0, -step]]
    rays = camera.rays(pixel_of(camera, u, v) + sides)
    assume(np.isfinite(rays).all())
    middle, right, left, below, above = rays
    assume(math.acos(middle[2]) < 0.97 * getattr(camera, 'reach', math.inf))
    solid_angle = abs(float(np.linalg.det([middle, right - left, below - above]))) / 4.0 / step**2
    resolution = camera.resolution(middle[None])[0]
    assert resolution == pytest.approx(math.sqrt(solid_angle), rel=1e-3)


@pytest.mark.parametrize('name', EVERY)
def test_many_pixels_are_back_projected_as_each_alone_and_none_to_no_ray(name: str) -> None:
    camera, pixels = EVERY[name], np.random.default_rng(0).uniform(0.0, 1000.0, (40, 2))
    alone = np.vstack([camera.rays(pixel[None]) for pixel in pixels])
    np.testing.assert_allclose(camera.rays(pixels), alone, atol=1e-13)
    assert camera.rays(np.empty((0, 2))).shape == (0, 3)
    assert camera.resolution(np.empty((0, 3))).shape == (0,)


@pytest.mark.parametrize('name', EVERY)
def test_a_ray_that_is_not_finite_does_not_come_back(name: str) -> None:
    camera, ahead = EVERY[name], np.array([[0.0, 0.0, 1.0]])
    rays, pixels = (
        np.vstack([[np.nan, 0.0, 1.0], *ahead]),
        np.vstack([[10.0, 10.0], *camera.pixels(ahead)]),
    )
    assert camera.round_trips(pixels, rays).tolist() == [False, True]


OPENCV = ('ideal, 180 deg', 'of a calibration', 'of a calibration, skewed')


@pytest.mark.parametrize('name', OPENCV)
@given(theta=floats(0.0, math.radians(85.0)), turn=floats(-math.pi, math.pi))
def test_it_is_the_lens_of_opencv_where_that_is_right(name, theta, turn) -> None:
    camera, seen = LENSES[name], ray(theta, turn)
    coefficients = np.array(camera.distortion or (0.0,) * 4)
    theirs, _ = cv2.fisheye.projectPoints(
        seen.reshape(1, 1, 3),
        np.zeros(3),
        np.zeros(3),
        camera.matrix,
        coefficients,
        alpha=camera.skew / camera.fx,
    )
    np.testing.assert_allclose(camera.pixels(seen), theirs.reshape(1, 2), atol=1e-6)


def test_what_is_behind_stays_on_its_side() -> None:
    # OpenCV's functions clamp this ray at 90 deg, or fold it over.
    behind = ray(math.radians(91.5), 0.0)
    assert behind[0, 2] < 0.0
    (u, v), *_ = WIDE.pixels(behind)
    assert 639.5 + WIDE.fx * math.pi / 2.0 < u < 1279.0
    assert v == pytest.approx(511.5)
    np.testing.assert_allclose(WIDE.rays(np.array([[u, v]])), behind, atol=1e-12)


def test_the_edges_of_a_lens_of_185_deg_are_behind() -> None:
    # Pixel centres are integers: half a pixel is missing at each side.
    half = math.radians(92.5) * 1279.0 / 1280.0
    assert WIDE.edges == pytest.approx((-half, half))
    assert LENSES['that folds'].edges[1] == pytest.approx(LENSES['that folds'].reach, abs=1e-3)


def test_directions_that_no_pixel_tells_have_none() -> None:
    for camera in LENSES.values():
        beyond = np.vstack([ray(camera.reach + 1e-3, 0.3), [[0.0, 0.0, -1.0]]])
        assert np.isnan(camera.pixels(beyond)).all()
        assert np.isfinite(camera.resolution(beyond)).all()
    far = np.array([[1e5, 511.0]])
    assert np.isnan(LENSES['that folds'].rays(far)).all()
    assert np.isnan(LENSES['ideal, 180 deg'].rays(far)).all()


def test_wide_is_what_sees_farther_than_usual_pinholes() -> None:
    assert WIDE.wide
    assert not Equidistant(1280, 1024, 923.0, 923.0, **CENTRE).wide
