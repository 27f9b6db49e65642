"""Intrinsics held against reason: slips are refused in a line, doubtful lenses are said."""

import math

import pytest

from visual_servo_epipolar.core.geometry.camera import Camera
from visual_servo_epipolar.core.geometry.cameras.calibrated import calibrated_camera
from visual_servo_epipolar.core.geometry.cameras.equidistant import Equidistant
from visual_servo_epipolar.core.geometry.cameras.plausibility import doubts, refuse_implausible

USUAL = {'width': 640, 'height': 480, 'fx': 400.0, 'fy': 400.0, 'cx': 320.0, 'cy': 240.0}
CAMERAS = (
    Camera(**USUAL),
    Camera(**{**USUAL, 'fy': 800.0}),  # of pixels binned in pairs
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
