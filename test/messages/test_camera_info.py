"""CameraInfo: binned, cropped and rectified images, and every lens that drivers name."""

import numpy as np
import pytest

from visual_servo_epipolar.core.cameras.equidistant import Equidistant
from visual_servo_epipolar.core.cameras.pinhole import Camera
from visual_servo_epipolar.messages import read, write

FULL = Camera(1280, 960, 800.0, 810.0, 641.0, 475.0, (-0.2, 0.05, 1e-3, -1e-3, 0.0))
SEEN = np.array([[0.1, -0.2, 1.0], [0.3, 0.2, 1.0]]) / np.sqrt([[1.05], [1.13]])


def info(camera=FULL):
    return write.camera_info(camera, 0, 'camera')


def crop(message, left, top, width, height) -> None:
    roi = message.roi
    roi.x_offset, roi.y_offset, roi.width, roi.height = left, top, width, height


def test_no_binning_may_be_0_or_1() -> None:
    message = info()
    message.binning_x, message.binning_y = 1, 0
    assert read.camera(message) == FULL


FULLS = [
    FULL,
    Camera(1280, 960, 800.0, 810.0, 641.0, 475.0, skew=4.0),
    Camera(1280, 960, 800.0, 810.0, 641.0, 475.0, (-0.2, 0.05, 1e-3, -1e-3, 0.0), skew=-6.0),
    Equidistant(1280, 960, 400.0, 410.0, 641.0, 475.0, (0.01, -0.002, 3e-4, -1e-4), skew=4.0),
]


@pytest.mark.parametrize('full', FULLS)
@pytest.mark.parametrize('binning', [(1, 1), (2, 2), (2, 4), (3, 1)])
@pytest.mark.parametrize('region', [(0, 0, 1280, 960), (300, 200, 640, 481)])
def test_an_image_is_cut_out_then_pixels_are_joined_about_their_centres(
    full, binning, region
) -> None:
    message = info(full)
    assert read.camera(message) == full
    crop(message, *region)
    message.binning_x, message.binning_y = binning
    camera = read.camera(message)
    assert (camera.width, camera.height) == (region[2] // binning[0], region[3] // binning[1])
    # Full pixels 0 and 1 are centred at 0.5; the binned pixel there is 0.
    expected = (full.pixels(SEEN) - region[:2] + 0.5) / binning - 0.5
    np.testing.assert_allclose(camera.pixels(SEEN), expected, atol=1e-9)


COLUMNS = [800.0, 0, 0, 0, 810.0, 0, 641.0, 475.0, 1, 0, 0, 0]  # P, transposed
SKEWED = Camera(1280, 960, 700.0, 705.0, 600.0, 470.0, skew=1.0)
P = [700.0, 1.0, 600.0, -42.0, 0.0, 705.0, 470.0, 0.0, 0.0, 0.0, 1.0, 0.0]
TURNED = [0.0, -1.0, 0.0, 1.0, 0.0, 0.0, 0.0, 0.0, 1.0]


@pytest.mark.parametrize('factor', [1.0, 2.0])
@pytest.mark.parametrize('full', [FULL, Equidistant(1280, 960, 400.0, 410.0, 641.0, 475.0)])
def test_of_rectified_images_p_holds_but_for_a_factor_and_the_lens_does_not(full, factor) -> None:
    message = info(full)
    message.p, message.r = factor * np.array(P), TURNED
    assert read.camera(message, rectified=True) == SKEWED
    assert read.camera(message) == full
    message.binning_x = message.binning_y = 2
    assert read.camera(message, rectified=True).fx == 350.0


@pytest.mark.parametrize(
    ('field', 'value', 'rectified', 'words'),
    [
        ('p', COLUMNS, True, 'P is transposed'),
        ('p', [0.0] * 12, True, r'got P\[0\] = 0; calibrate .* rectified: false'),
        ('k', [800, 0, 5e3, 0, 810, 475, 0, 0, 1], False, r'in the image .* u = 5000\.0 px'),
        ('k', [1e6, 0, 640, 0, 1e6, 480, 0, 0, 1], False, 'the field of view of a plumb_bob lens'),
    ],
)
def test_numbers_that_make_no_camera_are_refused(field, value, rectified, words) -> None:
    message = info()
    setattr(message, field, np.array(value, float))
    with pytest.raises(ValueError, match=words):
        read.camera(message, rectified=rectified)
    assert field == 'k' or read.camera(message) == FULL


def test_a_region_beyond_the_image_is_refused() -> None:
    message = info()
    crop(message, 1000, 100, 640, 480)
    with pytest.raises(ValueError, match='in the image of 1280x960 px, got 640x480 px at 1000'):
        read.camera(message)


def test_a_tiny_skew_of_an_optimiser_is_no_reason_to_refuse() -> None:
    message = info()
    message.k[1] = 1e-13
    np.testing.assert_allclose(read.camera(message).pixels(SEEN), FULL.pixels(SEEN), atol=1e-12)


@pytest.mark.parametrize(
    ('binning', 'region'), [(2, None), (4, None), (0, (320, 240, 640, 480)), (2, (0, 0, 640, 480))]
)
def test_k_of_the_image_sent_is_not_taken_for_that_of_the_full_one(binning, region) -> None:
    message = info()
    message.binning_x = message.binning_y = binning
    if region is not None:
        crop(message, *region)
    sent = read.camera(message)
    if region == (0, 0, 640, 480):
        assert (sent.cx + 0.5, sent.width) == (320.75, 320)  # off its middle: the region says why
    message.k = (np.array(message.k) / max(binning, 2)).tolist()
    message.k[8] = 1.0
    with pytest.raises(ValueError, match='K fits an image of .* before region and binning'):
        read.camera(message)
    assert read.camera(message, cropped=True).width == sent.width


@pytest.mark.parametrize('count', [12, 14])
def test_what_depth_cameras_say_of_every_lens_is_understood(count) -> None:
    distortion = (0.4, 0.1, 5e-4, -3e-4, 0.01, 0.7, 0.2, 0.02, *[0.0] * (count - 8))
    lens = Camera(1280, 720, 700.0, 700.0, 640.0, 360.0, distortion, 'rational_polynomial')
    assert read.camera(info(lens)) == lens


def test_rectified_or_not_is_the_same_for_a_lens_that_does_not_distort() -> None:
    plain = Camera(640, 480, 400.0, 401.0, 320.0, 240.0)
    assert read.camera(info(plain), rectified=True) == read.camera(info(plain)) == plain
