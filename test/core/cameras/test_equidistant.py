"""The fisheye lens: round trips over all that it sees, behind the camera as well."""

from dataclasses import replace
import math

import cv2
from hypothesis import given
from hypothesis import strategies as st
import numpy as np
import pytest
from strategies import floats

from visual_servo_epipolar.core.cameras.equidistant import Equidistant

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


@pytest.mark.parametrize('name', LENSES)
@given(u=floats(0.0, 1279.0), v=floats(0.0, 1023.0))
def test_a_pixel_comes_back_or_has_no_ray(name: str, u: float, v: float) -> None:
    camera, pixel = LENSES[name], np.array([[u, v]])
    rays = camera.rays(pixel)
    if np.isnan(rays).any():
        assert not camera.round_trips(pixel, rays).any()
    else:
        assert np.linalg.norm(rays) == pytest.approx(1.0, abs=1e-12)
        np.testing.assert_allclose(camera.pixels(rays), pixel, atol=1e-8)


OPENCV = ('ideal, 180 deg', 'of a calibration', 'of a calibration, skewed')


@pytest.mark.parametrize('name', OPENCV)
@given(theta=floats(0.0, math.radians(85.0)), turn=floats(-math.pi, math.pi))
def test_it_is_the_lens_of_opencv_where_that_is_right(
    name: str, theta: float, turn: float
) -> None:
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


def test_the_axis_is_the_principal_point() -> None:
    for camera in LENSES.values():
        np.testing.assert_array_equal(camera.pixels(ray(0.0, 0.0)), [[640.0, 511.0]])
        np.testing.assert_array_equal(camera.rays(np.array([[640.0, 511.0]])), ray(0.0, 0.0))


def test_directions_that_no_pixel_tells_have_none() -> None:
    for camera in LENSES.values():
        beyond = np.vstack([ray(camera.reach + 1e-3, 0.3), [[0.0, 0.0, -1.0]]])
        assert np.isnan(camera.pixels(beyond)).all()
        assert np.isfinite(camera.resolution(beyond)).all()
    far = np.array([[1e5, 511.0]])
    assert np.isnan(LENSES['that folds'].rays(far)).all()
    assert np.isnan(LENSES['ideal, 180 deg'].rays(far)).all()


@pytest.mark.parametrize('name', LENSES)
@given(share=floats(0.0, 0.97), turn=floats(-math.pi, math.pi))
def test_the_resolution_is_the_root_of_the_solid_angle_of_a_pixel(
    name: str, share: float, turn: float
) -> None:
    camera = LENSES[name]
    pixel = camera.pixels(ray(share * camera.reach, turn))
    step = 0.02
    sides = [[0.0, 0.0], [step, 0.0], [-step, 0.0], [0.0, step], [0.0, -step]]
    middle, right, left, below, above = camera.rays(pixel + sides)
    solid_angle = abs(float(np.linalg.det([middle, right - left, below - above]))) / 4.0 / step**2
    resolution = camera.resolution(middle[None])[0]
    assert resolution == pytest.approx(math.sqrt(solid_angle), rel=1e-3)


def test_many_pixels_are_back_projected_as_each_alone() -> None:
    pixels = np.random.default_rng(0).uniform(0.0, 1000.0, (40, 2))
    for camera in LENSES.values():
        alone = np.vstack([camera.rays(pixel[None]) for pixel in pixels])
        np.testing.assert_allclose(camera.rays(pixels), alone, atol=1e-13)
        assert camera.rays(np.empty((0, 2))).shape == (0, 3)
        assert camera.resolution(np.empty((0, 3))).shape == (0,)


def test_wide_is_what_sees_farther_than_usual_pinholes() -> None:
    assert WIDE.wide
    assert not Equidistant(1280, 1024, 923.0, 923.0, **CENTRE).wide


@pytest.mark.parametrize(
    ('change', 'message'),
    [
        ({'distortion': (0.1,) * 5}, 'must have 4 coefficients, got 5'),
        ({'fx': 0.0}, 'focal lengths must be positive'),
        ({'cy': math.nan}, 'intrinsics must be finite'),
        ({'width': 0}, 'image size must be positive, got 0x1024'),
    ],
)
def test_a_lens_that_cannot_be_is_refused(change: dict[str, float], message: str) -> None:
    values = {'width': 1280, 'height': 1024, 'fx': 400.0, 'fy': 400.0, **CENTRE}
    with pytest.raises(ValueError, match=message):
        Equidistant(**(values | change))
