"""Cameras by their names and matrices: K is taken whole, and a lens by what it is."""

from dataclasses import replace
import math

from hypothesis import given
from hypothesis import strategies as st
import numpy as np
import pytest
from strategies import floats

from visual_servo_epipolar.core.cameras.equidistant import Equidistant
from visual_servo_epipolar.core.cameras.pinhole import Camera
from visual_servo_epipolar.core.cameras.plausibility import (
    doubtful_tilt,
    doubts,
    refuse_implausible,
)
from visual_servo_epipolar.core.cameras.registry import (
    calibrated_camera,
    checked_matrix,
    scaled,
)

SIZE = (640, 480)
K = np.array([[400.0, 3.0, 320.0], [0.0, 401.0, 240.0], [0.0, 0.0, 1.0]])
P = np.column_stack([K, [-42.0, 0.0, 0.0]])
FACTORS = st.sampled_from([1.0, -1.0, 1e-3, 2.0, 16.0, 1e6])
FOUR = (0.01, -0.002, 3e-4, -1e-4)


@pytest.mark.parametrize('matrix', [K, P])
@given(factor=FACTORS, noise=floats(-1e-13, 1e-13))
def test_a_common_factor_is_divided_out(matrix: np.ndarray, factor: float, noise: float) -> None:
    rows = (matrix * factor).copy()
    rows[1, 0] += noise * factor  # as optimisers leave it
    np.testing.assert_allclose(checked_matrix(rows.ravel()), K, rtol=1e-12, atol=1e-12)


@pytest.mark.parametrize(('matrix', 'name'), [(K, 'K'), (P, 'P')])
@given(factor=FACTORS)
def test_a_matrix_by_columns_is_named(matrix: np.ndarray, name: str, factor: float) -> None:
    with pytest.raises(ValueError, match=f'{name} is transposed: its rows must be .* row by row'):
        checked_matrix((factor * matrix).T.ravel(), name)


@pytest.mark.parametrize(('matrix', 'name'), [(K, 'K'), (P, 'P')])
@given(data=st.data(), value=floats(1e-3, 1e3))
def test_whatever_stands_where_zeros_must_is_refused(matrix, name, data, value) -> None:
    rows = matrix.copy()
    places = [(1, 0), (2, 0), (2, 1)] + ([(2, 3)] if name == 'P' else [])
    rows[data.draw(st.sampled_from(places))] = value
    with pytest.raises(ValueError, match=f'the rows of {name} must be'):
        checked_matrix(rows.ravel(), name)


@pytest.mark.parametrize('factor', [0.0, 1e-300, 1e-12])
def test_a_last_row_that_is_hardly_there_is_refused(factor: float) -> None:
    with pytest.raises(ValueError, match='the rows of K must be'):
        checked_matrix((K * [[1.0], [1.0], [factor]]).ravel())


@pytest.mark.parametrize(
    ('name', 'distortion', 'expected'),
    [
        *(
            (name, (*FOUR, *[0.0] * zeros), FOUR)
            for name in ('equidistant', 'fisheye', 'kannala_brandt4', 'equi', ' Equidistant ')
            for zeros in (0, 1, 4)
        ),
        *(
            (name, (*FOUR, *[0.0] * zeros), (*FOUR, 0.0) if zeros else FOUR)
            for name in ('plumb_bob', 'radtan', 'radial-tangential', 'Plumb_Bob')
            for zeros in (0, 1, 3, 4, 9)
        ),
        *((name, (0.0,) * count, ()) for name in ('', 'none', 'NONE') for count in range(9)),
        ('rational_polynomial', (*FOUR, 0.1, 0.2, 0.3, 0.4, 0.0), (*FOUR, 0.1, 0.2, 0.3, 0.4)),
        ('plumb_bob', (0.0,) * 3, ()),
    ],
)
def test_a_lens_is_what_its_name_and_numbers_mean(name, distortion, expected) -> None:
    camera = calibrated_camera(SIZE, K.ravel(), distortion, name)
    assert camera.distortion == expected
    fisheye = 'e' in name.strip().lower()[:1] or name in ('fisheye', 'kannala_brandt4')
    assert isinstance(camera, Equidistant if fisheye else Camera)


@pytest.mark.parametrize(
    ('name', 'distortion'),
    [
        ('equidistant', (*FOUR, 0.1)),
        ('kannala_brandt4', (*FOUR, 0.0, 1e-9)),
        ('plumb_bob', (*FOUR, 0.1, 0.1)),
        ('plumb_bob', (0.1, 0.0, 0.0)),
        ('', (0.1, 0.0, 0.0, 0.0)),
        ('none', (0.0, 0.0, 0.0, 1e-9)),
        ('omni', ()),
        ('ftheta', (0.0,) * 4),
        ('rational_polynomial', (0.1,) * 5),
    ],
)
def test_a_coefficient_that_means_nothing_is_refused(name, distortion) -> None:
    with pytest.raises(ValueError, match='must (be|have)'):
        calibrated_camera(SIZE, K.ravel(), distortion, name)


@pytest.mark.parametrize('name', ['plumb_bob', 'equidistant'])
@given(scale=st.tuples(floats(0.2, 5.0), floats(0.2, 5.0)))
def test_a_scaled_image_shows_the_same_directions(name: str, scale: tuple[float, float]) -> None:
    camera = calibrated_camera(SIZE, K.ravel(), FOUR, name)
    pixels = np.random.default_rng(0).uniform(0.0, 480.0, (20, 2))
    other = scaled(camera, (100, 100), *scale)
    moved = (pixels + 0.5) * scale - 0.5
    np.testing.assert_allclose(other.rays(moved), camera.rays(pixels), atol=1e-9)
    assert other != replace(other, skew=0.0)


USUAL = {'width': 640, 'height': 480, 'fx': 400.0, 'fy': 400.0, 'cx': 320.0, 'cy': 240.0}
CAMERAS = (
    Camera(**USUAL),
    Camera(**{**USUAL, 'fy': 800.0}),  # of pixels binned in pairs
    Camera(**USUAL, skew=4.0),
    Camera(**USUAL, distortion=(-0.3, 0.1, 0.0, 0.0, 0.0)),
    Equidistant(640, 480, 640.0 / math.radians(190.0), 193.0, 320.0, 240.0),
)


@pytest.mark.parametrize('camera', CAMERAS)
def test_usual_cameras_are_beyond_doubt(camera: Camera | Equidistant) -> None:
    refuse_implausible(camera)
    assert doubts(camera) == ''


@pytest.mark.parametrize(
    ('kind', 'change', 'message'),
    [
        (Camera, {'cx': 961.0}, r'u = 961\.0 px of 640; is the camera_info that of another'),
        (Camera, {'cx': -321.0}, r'u = -321\.0 px of 640'),
        (Camera, {'cy': 1000.0}, r'v = 1000\.0 px of 480'),
        (Equidistant, {'cx': 1280.0}, r'u = 1280\.0 px of 640'),
        (Camera, {'fx': 20.0, 'fy': 20.0}, r'between 1 and 170 deg, got 170\.\d+: fx 20 px'),
        (Camera, {'fx': 5e4, 'fy': 5e4}, r'of a pinhole lens must lie .* got 0\.55: fx 50000'),
        (Camera, {'fx': 1e-300}, r'alike, to a factor of 4, got fx 1e-300 and fy 400 px'),
        (Camera, {'fy': 1640.0}, r'alike, to a factor of 4, got fx 400 and fy 1640 px'),
        (Equidistant, {'fy': 1.0}, r'alike, to a factor of 4'),
        (Equidistant, {'fx': 50.0, 'fy': 50.0}, r'between 1 and 360 deg, got 548'),
    ],
)
def test_what_no_camera_is_is_refused(kind, change, message) -> None:
    with pytest.raises(ValueError, match=message):
        refuse_implausible(kind(**(USUAL | change)))


@pytest.mark.parametrize('camera', CAMERAS)
@pytest.mark.parametrize(
    ('scale', 'other'),
    [
        (0.25, '160x120'),
        (1 / 3, '213x160'),
        (1.25, '800x600'),
        (3.0, '1920x1440'),
    ],
)
def test_k_of_another_resolution_names_it(camera, scale, other) -> None:
    wrong = replace(camera, cx=scale * (camera.cx + 7.0), cy=scale * (camera.cy - 5.0))
    with pytest.raises(ValueError, match=f'must lie .*: K fits an image of {other} px; '):
        refuse_implausible(wrong)


@pytest.mark.parametrize('camera', CAMERAS)
@given(scale=floats(0.2, 5.0))
def test_no_scale_of_k_is_believed(camera: Camera | Equidistant, scale: float) -> None:
    wrong = scaled(camera, (640, 480), scale, scale)
    if 0.93 < scale < 1.07:
        refuse_implausible(wrong)  # this is near enough to be a lens off its centre
    elif not 0.89 < scale < 1.11:
        with pytest.raises(ValueError):
            refuse_implausible(wrong)


@pytest.mark.parametrize('camera', CAMERAS)
@given(u=floats(-0.5, 1.5), v=floats(-0.5, 1.5))
def test_a_principal_point_is_in_the_middle_or_that_of_a_crop(camera, u, v) -> None:
    off_centre = replace(camera, fx=300.0, fy=300.0, cx=u * 640.0, cy=v * 480.0)
    refuse_implausible(off_centre, cropped=True)
    if not (0.29 < u < 0.71 and 0.29 < v < 0.71):
        with pytest.raises(ValueError, match='or say that the image is a crop'):
            refuse_implausible(off_centre)
    u, v = 0.31 + 0.19 * (u + 0.5), 0.31 + 0.19 * (v + 0.5)
    if abs(u - v) > 0.06 * (u + v) / 2 + 0.002:  # not in proportion
        refuse_implausible(replace(camera, cx=u * 640.0, cy=v * 480.0))


@pytest.mark.parametrize('camera', CAMERAS)
@given(off=floats(-20.0, 20.0), tilt=floats(-0.5, 0.5))
def test_a_tilt_is_doubted_where_the_principal_point_makes_it(camera, off, tilt) -> None:
    distance = camera.fy * math.tan(math.radians(off))
    if isinstance(camera, Equidistant):
        distance = camera.fy * math.radians(off)
    wrong = replace(camera, cy=239.5 + distance, distortion=())
    made = math.radians(off)
    if abs(off) > 3.1:
        assert 'of another image' in doubtful_tilt(wrong, made)
    if abs(off) < 2.0 or abs(tilt - made) > 0.5 * abs(made):
        assert doubtful_tilt(wrong, tilt) == ''
    assert doubtful_tilt(wrong, math.nan) == ''


def test_a_distortion_that_folds_within_the_image_is_said() -> None:
    folding = Camera(**(USUAL | {'fx': 250.0, 'fy': 250.0}), distortion=(-0.4, 0.0, 0.0, 0.0))
    refuse_implausible(folding)
    said = doubts(folding)
    assert 'plumb_bob) cannot be undone in' in said
    assert 20 < float(said.split(' % ')[0].split()[-1]) < 80
