"""Intrinsics held against reason: slips are refused in a line, doubtful lenses are said."""

from dataclasses import replace
import math

from hypothesis import given
import pytest
from strategies import floats

from visual_servo_epipolar.core.cameras.equidistant import Equidistant
from visual_servo_epipolar.core.cameras.pinhole import Camera
from visual_servo_epipolar.core.cameras.plausibility import (
    doubtful_tilt,
    doubts,
    refuse_implausible,
)
from visual_servo_epipolar.core.cameras.registry import calibrated_camera, scaled

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
def test_what_no_camera_is_is_refused(
    kind: type[Camera] | type[Equidistant], change: dict[str, float], message: str
) -> None:
    with pytest.raises(ValueError, match=message):
        refuse_implausible(kind(**(USUAL | change)))


@pytest.mark.parametrize('camera', CAMERAS)
@pytest.mark.parametrize(
    ('scale', 'other'),
    [
        (0.25, '160x120'),
        (1 / 3, '213x160'),
        (0.5, '320x240'),
        (0.75, '480x360'),
        (1.25, '800x600'),
        (2.0, '1280x960'),
        (3.0, '1920x1440'),
        (4.0, '2560x1920'),
    ],
)
def test_k_of_another_resolution_names_it(
    camera: Camera | Equidistant, scale: float, other: str
) -> None:
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
@given(u=floats(0.31, 0.69), v=floats(0.31, 0.69))
def test_a_principal_point_may_be_anywhere_in_the_middle(
    camera: Camera | Equidistant, u: float, v: float
) -> None:
    off_centre = replace(camera, cx=u * 640.0, cy=v * 480.0)
    if abs(u - v) > 0.06 * (u + v) / 2 + 0.002:  # not in proportion
        refuse_implausible(off_centre)


@pytest.mark.parametrize('camera', CAMERAS)
@given(u=floats(-0.5, 1.5), v=floats(-0.5, 1.5))
def test_the_principal_point_of_a_crop_may_be_anywhere(
    camera: Camera | Equidistant, u: float, v: float
) -> None:
    off_centre = replace(camera, fx=300.0, fy=300.0, cx=u * 640.0, cy=v * 480.0)
    refuse_implausible(off_centre, cropped=True)
    if not (0.29 < u < 0.71 and 0.29 < v < 0.71):
        with pytest.raises(ValueError, match='or say that the image is a crop'):
            refuse_implausible(off_centre)


@pytest.mark.parametrize('camera', CAMERAS)
@given(off=floats(-20.0, 20.0), tilt=floats(-0.5, 0.5))
def test_a_tilt_is_doubted_where_the_principal_point_makes_it(
    camera: Camera | Equidistant, off: float, tilt: float
) -> None:
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


def test_both_names_of_a_fisheye_are_one_lens() -> None:
    k = (200.0, 0.0, 320.0, 0.0, 200.0, 240.0, 0.0, 0.0, 1.0)
    lenses = [
        calibrated_camera((640, 480), k, (0.01, 0.0, 0.0, 0.0), name)
        for name in ('equidistant', 'fisheye')
    ]
    assert lenses[0] == lenses[1] == Equidistant(640, 480, 200, 200, 320, 240, (0.01, 0, 0, 0))
