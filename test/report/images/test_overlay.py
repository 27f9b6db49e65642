"""Marks stand where the features are, in the colours of the paper."""

import numpy as np
import pytest

from visual_servo_epipolar.core.arrays import FloatArray, Image
from visual_servo_epipolar.report.images.overlay import draw_overlay, epipolar_segments

SIZES = [(1280, 1024), (640, 480)]
# A pure translation along the optical axis: both epipoles at (u, v), F = [e]x.
EPIPOLE = 400.0, 240.0


def gray(size: tuple[int, int]) -> Image:
    return np.full(size[::-1], 128, dtype=np.uint8)


def skew(u: float, v: float) -> FloatArray:
    return np.array([[0.0, -1.0, v], [1.0, 0.0, -u], [-v, u, 0.0]])


def is_red(pixel: Image) -> bool:
    return bool(pixel[2] > 200 and pixel[1] < 110 and pixel[0] < 110)


def is_green(pixel: Image) -> bool:
    return bool(pixel[1] > 180 and pixel[2] < 120 and pixel[0] < 120)


@pytest.mark.parametrize('size', SIZES)
def test_current_is_a_red_cross_and_desired_a_green_circle(size: tuple[int, int]) -> None:
    image, current, desired = gray(size), np.array([[200.0, 300.0]]), np.array([[400.0, 200.0]])
    picture = draw_overlay(image, current, desired, header='displacing')
    assert (image == gray(size)).all() and picture.shape == (size[1], size[0], 3)
    blue, green, red = picture[250, 300].astype(int)  # a line joins the two
    assert min(red, green) > 200 and blue < 130
    assert is_red(picture[300, 200])
    around = picture[200, 400:420]
    assert any(is_green(pixel) for pixel in around)
    assert not is_green(picture[200, 400])
    assert not any(is_red(pixel) for pixel in around)


def test_epipolar_line_of_the_desired_point_runs_through_the_current_one() -> None:
    current = np.array([[200.0, 340.0]])
    desired = np.array(EPIPOLE) + 1.5 * (current - EPIPOLE)
    plain = draw_overlay(gray((640, 480)), current, desired)
    lined = draw_overlay(gray((640, 480)), current, desired, fundamental=skew(*EPIPOLE))
    across = round(EPIPOLE[0] + 100.0), round(EPIPOLE[1] - 50.0)  # on the line, beyond the epipole
    assert (plain[across[1], across[0]] == 128).all()
    assert lined[across[1], across[0], 0] > 150


def test_segments_lie_on_their_lines_and_those_that_miss_are_left_out() -> None:
    lines = np.array([[1.0, 2.0, -700.0], [0.0, 0.0, 1.0], [1.0, 0.0, 5000.0]])
    segments = epipolar_segments(lines, 640, 480)
    assert segments.shape == (1, 2, 2)
    np.testing.assert_allclose(segments[0] @ lines[0, :2] + lines[0, 2], 0.0, atol=1e-9)


@pytest.mark.parametrize('abscissa', [320.0, -50.0, 1e7, float('nan'), float('inf'), None])
def test_an_epipole_in_the_image_is_marked_on_the_horizon(abscissa: float | None) -> None:
    none = np.empty((0, 2))
    marked = draw_overlay(gray((640, 480)), none, none, epipole_current=abscissa, horizon=200.0)
    assert (marked[200, 320, 1] < 110) == (abscissa == 320.0)
    assert (marked[60 if abscissa != 320.0 else 260 :] == 128).all()


def test_no_features_far_features_and_an_unknown_phase_are_drawn() -> None:
    far = np.array([[1e9, -1e9]])
    picture = draw_overlay(gray((640, 480)), far, far, header='tracking')
    assert picture.shape == (480, 640, 3)
    assert (picture[60:] == 128).all()  # nothing of a feature that is out of the image
    assert (picture[:60] != 128).any()  # the phase stands there
    empty = draw_overlay(gray((64, 48)), far[:0], far[:0], fundamental=skew(*EPIPOLE))
    assert empty.shape == (48, 64, 3)
