"""Textures: grey pictures and their prefiltered copies."""

import math

import cv2
import numpy as np

from visual_servo_epipolar.core.arrays import as_gray, frozen, Image
from visual_servo_epipolar.simulation.rendering.sheets import Box, Sheet

# Blur of the imaginary lens and pixel together [px]. Less aliases, more looks out of focus: at
# 0.42 px a contrast of 42 % is left at the Nyquist frequency and 6 % at the pixel frequency.
LENS_SIGMA = 0.42
# What a copy is blurred already, drawn or reduced, and by bilinear sampling [texel^2].
TEXEL_VARIANCE = 0.5
DOUBLED_VARIANCE = 1.6
# The sharpest copy, the doubled one, is blurred as if a pixel spanned so many texels.
SHARPEST = math.sqrt(DOUBLED_VARIANCE) / (2.0 * LENS_SIGMA)


class Texture:
    """
    A grey picture and its copies, blurred and reduced along rows and columns separately.

    Copies are counted in half octaves (p, q): copy (p, q) is fit to be sampled bilinearly where
    one pixel of the image spans 2^(p/2) texels along a row and 2^(q/2) along a column. They are
    made where and when they are first asked for, and keep two to three texels a pixel: bilinear
    sampling of fewer would shift details by some hundredths of a pixel. The original is doubled
    if it has fewer.
    """

    def __init__(self, image: Image) -> None:
        self.image: Image = frozen(as_gray(image, 'texture'))
        self._reduced: dict[tuple[int, int], Sheet] = {(0, 0): Sheet.of(self.image)}
        self._filtered: dict[tuple[int, int], tuple[Sheet, int, int]] = {}

    def filtered(self, p: int, q: int) -> tuple[Sheet, int, int]:
        """Return copy (p, q), and how often its columns and rows were halved."""
        if (p, q) not in self._filtered:
            i, j = (p - 2) // 2, (q - 2) // 2
            sigmas = _sigma(2.0 ** (p / 2 - i), i), _sigma(2.0 ** (q / 2 - j), j)
            self._filtered[p, q] = _blurred(self._level(i, j), *sigmas), i, j
        return self._filtered[p, q]

    def _level(self, i: int, j: int) -> Sheet:
        """Return the picture with columns halved i times and rows j times; -1 is doubled."""
        if (i, j) not in self._reduced:
            if i > 0:
                sheet = _fewer_columns(self._level(i - 1, j))
            elif j > 0:
                sheet = _fewer_rows(self._level(i, j - 1))
            else:
                sheet = _doubled(self._reduced[0, 0], i < 0, j < 0)
            self._reduced[i, j] = sheet
        return self._reduced[i, j]


def _sigma(texels_a_pixel: float, halvings: int) -> float:
    """Return the blur [texels] still missing where a pixel spans ``texels_a_pixel``."""
    variance = DOUBLED_VARIANCE if halvings < 0 else TEXEL_VARIANCE
    return math.sqrt(max(0.0, (LENS_SIGMA * texels_a_pixel) ** 2 - variance))


def _blurred(source: Sheet, sigma_u: float, sigma_v: float) -> Sheet:
    """Blur columns and rows by their own Gaussian; a sigma of 0 leaves them alone."""
    if sigma_u == 0.0 and sigma_v == 0.0:
        return source
    u, v = math.ceil(3.0 * sigma_u), math.ceil(3.0 * sigma_v)
    # OpenCV reads a sigma of 0 as "choose one"; a kernel of one tap ignores it.
    sigmas = {'sigmaX': max(sigma_u, 0.1), 'sigmaY': max(sigma_v, 0.1)}

    def make(box: Box) -> Image:
        left, top, right, bottom = box
        part = source.part((left - u, top - v, right + u, bottom + v))
        blurred = cv2.GaussianBlur(part, (2 * u + 1, 2 * v + 1), **sigmas)
        return np.asarray(blurred[v : v + bottom - top, u : u + right - left], dtype=np.uint8)

    return Sheet(source.shape, make)


def _fewer_rows(source: Sheet) -> Sheet:
    """Halve the rows by (1 3 3 1) / 8; where they are odd the last one counts twice."""

    def make(box: Box) -> Image:
        left, top, right, bottom = box
        return _halved(source.part((left, 2 * top - 1, right, 2 * bottom + 1)))

    rows, columns = source.shape
    return Sheet(((rows + 1) // 2, columns), make)


def _fewer_columns(source: Sheet) -> Sheet:
    """Halve the columns, as ``_fewer_rows`` does the rows."""

    def make(box: Box) -> Image:
        left, top, right, bottom = box
        part = source.part((2 * left - 1, top, 2 * right + 1, bottom))
        return np.asarray(cv2.transpose(_halved(cv2.transpose(part))), dtype=np.uint8)

    rows, columns = source.shape
    return Sheet((rows, (columns + 1) // 2), make)


def _halved(padded: Image) -> Image:
    """Halve the rows of ``padded``, (2 N + 2, W), by (1 3 3 1) / 8."""
    total = cv2.add(padded[1:-1:2], padded[2:-1:2], dtype=cv2.CV_16U)
    total *= 3
    total += cv2.add(padded[:-2:2], padded[3::2], dtype=cv2.CV_16U)
    total += 4
    total >>= 3
    return np.asarray(total.astype(np.uint8))


def _doubled(source: Sheet, columns: bool, rows: bool) -> Sheet:
    """Double columns or rows, or both, by cubic interpolation."""
    fx, fy = 1 + columns, 1 + rows
    u, v = 2 * columns, 2 * rows  # how far the interpolation reaches

    def make(box: Box) -> Image:
        left, top, right, bottom = box
        part = source.part((left // fx - u, top // fy - v, right // fx + u, bottom // fy + v))
        larger = cv2.resize(part, None, fx=fx, fy=fy, interpolation=cv2.INTER_CUBIC)
        u0, v0 = fx * u, fy * v
        return np.asarray(larger[v0 : v0 + bottom - top, u0 : u0 + right - left], dtype=np.uint8)

    return Sheet((fy * source.shape[0], fx * source.shape[1]), make)
