"""CameraInfo: binned, cropped and rectified images, and every lens that drivers name."""

import math

import cv2
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


def test_a_region_of_interest_shifts_the_image() -> None:
    message = info()
    crop(message, 200, 100, 640, 480)
    camera = read.camera(message)
    assert (camera.width, camera.height) == (640, 480)
    np.testing.assert_allclose(camera.pixels(SEEN), FULL.pixels(SEEN) - [200.0, 100.0], atol=1e-9)


def test_binning_joins_pixels_about_their_common_centre() -> None:
    message = info()
    message.binning_x, message.binning_y = 2, 4
    camera = read.camera(message)
    assert (camera.width, camera.height) == (640, 240)
    # Full pixels 0 and 1 are centred at 0.5; the binned pixel there is 0.
    expected = (FULL.pixels(SEEN) + 0.5) / [2.0, 4.0] - 0.5
    np.testing.assert_allclose(camera.pixels(SEEN), expected, atol=1e-9)


def test_a_region_is_cut_out_before_it_is_binned() -> None:
    message = info()
    crop(message, 200, 100, 640, 481)
    message.binning_x = message.binning_y = 2
    camera = read.camera(message)
    assert (camera.width, camera.height) == (320, 240)
    expected = (FULL.pixels(SEEN) - [200.0, 100.0] + 0.5) / 2.0 - 0.5
    np.testing.assert_allclose(camera.pixels(SEEN), expected, atol=1e-9)


def test_no_binning_may_be_0_or_1_and_no_region_may_be_all_or_nothing() -> None:
    message = info()
    message.binning_x, message.binning_y = 1, 0
    assert read.camera(message) == FULL
    crop(message, 0, 0, 1280, 960)
    assert read.camera(message) == FULL


SKEWED = [
    Camera(1280, 960, 800.0, 810.0, 641.0, 475.0, skew=4.0),
    Camera(1280, 960, 800.0, 810.0, 641.0, 475.0, (-0.2, 0.05, 1e-3, -1e-3, 0.0), skew=-6.0),
    Equidistant(1280, 960, 400.0, 410.0, 641.0, 475.0, (0.01, -0.002, 3e-4, -1e-4), skew=4.0),
]


@pytest.mark.parametrize('full', SKEWED)
@pytest.mark.parametrize('binning', [(1, 1), (2, 2), (2, 4), (3, 1)])
def test_skew_is_cut_and_binned_as_the_image_is(full, binning) -> None:
    message = info(full)
    assert read.camera(message) == full
    crop(message, 300, 200, 640, 480)
    message.binning_x, message.binning_y = binning
    expected = (full.pixels(SEEN) - [300.0, 200.0] + 0.5) / binning - 0.5
    np.testing.assert_allclose(read.camera(message).pixels(SEEN), expected, atol=1e-9)


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


def test_p_by_columns_is_named_where_it_holds() -> None:
    message = info()
    message.p = np.array(message.p).reshape(3, 4).T.ravel()
    assert read.camera(message) == FULL
    with pytest.raises(ValueError, match='P is transposed'):
        read.camera(message, rectified=True)


def test_a_common_factor_of_p_is_divided_out() -> None:
    message = info()
    message.p = 2.0 * np.array([700.0, 1.0, 600.0, -42.0, 0.0, 705.0, 470.0, 0.0, 0.0, 0, 1, 0])
    rectified = Camera(1280, 960, 700.0, 705.0, 600.0, 470.0, skew=1.0)
    assert read.camera(message, rectified=True) == rectified


def test_a_region_beyond_the_image_is_refused() -> None:
    message = info()
    crop(message, 1000, 100, 640, 480)
    with pytest.raises(ValueError, match='in the image of 1280x960 px, got 640x480 px at 1000'):
        read.camera(message)


def test_of_rectified_images_p_holds_and_the_distortion_does_not() -> None:
    message = info()
    message.p = [700.0, 0.0, 600.0, -42.0, 0.0, 705.0, 470.0, 0.0, 0.0, 0.0, 1.0, 0.0]
    message.r = np.array([0.0, -1.0, 0.0, 1.0, 0.0, 0.0, 0.0, 0.0, 1.0])
    expected = Camera(1280, 960, 700.0, 705.0, 600.0, 470.0)
    assert read.camera(message, rectified=True) == expected
    assert read.camera(message) == FULL
    message.binning_x = message.binning_y = 2
    assert read.camera(message, rectified=True).fx == 350.0


def test_rectified_or_not_is_the_same_for_a_lens_that_does_not_distort() -> None:
    plain = Camera(640, 480, 400.0, 401.0, 320.0, 240.0)
    assert read.camera(info(plain), rectified=True) == read.camera(info(plain)) == plain


def test_rectified_images_of_an_uncalibrated_camera_are_refused() -> None:
    message = info()
    message.p = np.zeros(12)
    with pytest.raises(ValueError, match=r'got P\[0\] = 0; calibrate .* rectified: false'):
        read.camera(message, rectified=True)


def test_a_fisheye_that_was_rectified_is_a_pinhole() -> None:
    message = info(Equidistant(640, 480, 200.0, 200.0, 320.0, 240.0, (0.01, 0.0, 0.0, 0.0)))
    message.p[0] = message.p[5] = 150.0
    assert read.camera(message, rectified=True) == Camera(640, 480, 150.0, 150.0, 320.0, 240.0)


@pytest.mark.parametrize('count', [12, 14])
def test_what_depth_cameras_say_of_every_lens_is_understood(count) -> None:
    distortion = (0.4, 0.1, 5e-4, -3e-4, 0.01, 0.7, 0.2, 0.02, *[0.0] * (count - 8))
    lens = Camera(1280, 720, 700.0, 700.0, 640.0, 360.0, distortion, 'rational_polynomial')
    assert read.camera(info(lens)) == lens


def test_implausible_intrinsics_are_refused() -> None:
    message = info()
    message.k[2] = 5000.0
    with pytest.raises(ValueError, match=r'must lie in the image .* u = 5000\.0 px of 1280'):
        read.camera(message)
    message = info(Camera(1280, 960, 1e6, 1e6, 640.0, 480.0))
    assert math.isclose(message.k[0], 1e6)
    with pytest.raises(ValueError, match='the field of view of a pinhole lens'):
        read.camera(message)


def test_rectified_pixels_show_what_raw_ones_do_as_the_rectified_camera_is_turned() -> None:
    message = info()
    rotation, _ = cv2.Rodrigues(np.array([0.02, -0.03, 0.01]))
    message.r = rotation.ravel()
    message.p = [700.0, 0.0, 620.0, -42.0, 0.0, 705.0, 470.0, 0.0, 0.0, 0.0, 1.0, 0.0]
    raw = np.random.default_rng(0).uniform(100.0, 800.0, (50, 2))
    projection = np.array(message.p).reshape(3, 4)[:, :3]
    rectified = cv2.undistortPoints(
        raw.reshape(-1, 1, 2), FULL.matrix, np.array(FULL.distortion), R=rotation, P=projection
    ).reshape(-1, 2)
    turned = read.camera(message).rays(raw) @ rotation.T
    # OpenCV stops after five iterations.
    seen = read.camera(message, rectified=True).rays(rectified)
    np.testing.assert_allclose(seen, turned, atol=1e-4)
