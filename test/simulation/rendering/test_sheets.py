"""Copies of textures are made where somebody looks, and are what they would be as a whole."""

import numpy as np
import pytest

from visual_servo_epipolar.core.arrays import Image
from visual_servo_epipolar.simulation.rendering.surfaces import _blur, Box, Sheet, Texture, TILE

COPIES = [(0, 0), (1, 4), (2, 2), (3, 3), (4, 1), (5, 8), (7, 6)]
BOXES = [(300, 10, 310, 600), (0, 0, 1, 1), (700, 900, 701, 901), (500, 250, 530, 262)]


@pytest.fixture(scope='module')
def noise() -> Image:
    rng = np.random.default_rng(3)
    return rng.integers(0, 256, (1203, 901)).astype(np.uint8)  # odd, and no multiple of a tile


@pytest.mark.parametrize('copy', COPIES)
def test_a_copy_made_in_pieces_is_that_made_as_a_whole(noise: Image, copy) -> None:
    whole = Texture(noise).filtered(*copy)[0].whole()
    sheet, i, j = Texture(noise).filtered(*copy)
    scale = 2.0**-i, 2.0**-j
    for left, top, right, bottom in BOXES:
        box = (
            int(scale[0] * left),
            int(scale[1] * top),
            int(scale[0] * right) + 1,
            int(scale[1] * bottom) + 1,
        )
        at = np.s_[box[1] : box[3], box[0] : box[2]]
        np.testing.assert_array_equal(sheet.made(box)[at], whole[at])
    np.testing.assert_array_equal(sheet.whole(), whole)


def test_only_what_is_asked_for_is_made_and_once() -> None:
    asked: list[Box] = []

    def make(box: Box) -> Image:
        asked.append(box)
        left, top, right, bottom = box
        return np.full((bottom - top, right - left), len(asked), np.uint8)

    sheet = Sheet((3 * TILE + 5, 2 * TILE + 9), make)
    sheet.made((TILE + 1, 0, TILE + 2, 1))
    sheet.made((TILE + 1, 3, 2 * TILE, TILE))
    assert asked == [(TILE, 0, 2 * TILE, TILE)]
    picture = sheet.made((0, 0, 1, TILE + 1))
    assert asked[1:] == [(0, 0, TILE, 2 * TILE)]
    assert (picture[0, 0], picture[0, TILE]) == (2, 1)
    sheet.whole()
    sheet.whole()
    assert len(asked) == 3
    assert asked[2][2:] == (2 * TILE + 9, 3 * TILE + 5)


def test_beyond_the_border_its_pixels_are_repeated() -> None:
    sheet = Sheet.of(np.arange(12, dtype=np.uint8).reshape(3, 4))
    part = sheet.part((-2, -1, 5, 4))
    assert part.shape == (5, 7)
    np.testing.assert_array_equal(part[1, :3], [0, 0, 0])
    np.testing.assert_array_equal(part[-1, -2:], [11, 11])


def variances(image: np.ndarray) -> tuple[float, float]:
    """Return the variance of the grey of ``image`` along rows and columns [texel^2]."""
    v, u = np.mgrid[: image.shape[0], : image.shape[1]]
    weights = image / image.sum(dtype=float)
    along, across = ((weights * (at - (weights * at).sum()) ** 2).sum() for at in (u, v))
    return along, across


@pytest.mark.parametrize(('sigma_u', 'sigma_v'), [(0.6, 2.0), (2.0, 0.6), (0.0, 1.5), (1.5, 0.0)])
def test_each_axis_is_blur_by_its_own_gaussian(sigma_u: float, sigma_v: float) -> None:
    block = np.zeros((101, 101), np.uint8)
    block[40:61, 40:61] = 250
    before, after = (
        variances(block),
        variances(_blur(Sheet.of(block), sigma_u, sigma_v).whole()),
    )
    # A kernel ends at three deviations, and grey levels are rounded.
    assert after[0] - before[0] == pytest.approx(sigma_u**2, rel=0.05, abs=0.02)
    assert after[1] - before[1] == pytest.approx(sigma_v**2, rel=0.05, abs=0.02)
