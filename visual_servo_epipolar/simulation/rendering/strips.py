"""Strips: parts of surfaces, and how each is sampled."""

from typing import NamedTuple

import numpy as np

from visual_servo_epipolar.core.arrays import FloatArray, IntArray
from visual_servo_epipolar.simulation.rendering.surfaces import Scene
from visual_servo_epipolar.simulation.rendering.textures import SHARPEST

MAX_SKEW = 1.5  # area blurred by texture copies over area of a pixel, before it is subdivided
MAX_SUBDIVISION = 8
WORTHWHILE = 0.93  # more parts must reduce the blurred area to so much of it
# Into how many columns and rows a pixel may be cut, the fewest first, shape (N, 2).
SUBDIVISIONS = np.array(
    [(1, 1), *(pair for n in range(2, MAX_SUBDIVISION + 1) for pair in ((1, n), (n, 1)))]
)
SPREAD = 0.7  # a part is judged at its corners, drawn in to its middle so much


class Strip(NamedTuple):
    """A part of a surface that is sampled in one way."""

    surface: int
    side: int  # of the image: -1, 0, 1
    p: int  # copy (p, q) of the texture
    q: int
    columns: int  # subdivisions of a pixel
    rows: int


class Parts(NamedTuple):
    """Parts of surfaces, each sampled in one way: corners [px], shape (C, 2), one by one."""

    owners: IntArray  # index into the surfaces shown, shape (P,)
    sides: list[int]  # of the image
    corners: FloatArray
    starts: IntArray  # of each part in the corners, shape (P,)
    sizes: IntArray  # how many corners it has, shape (P,)


def sampling(scene: Scene, shown: IntArray, maps: FloatArray, parts: Parts) -> list[Strip]:
    """Choose how each part of a surface is sampled: for the mean over its corners."""
    owners, sides, corners, starts, sizes = parts
    if not len(owners):
        return []
    middles = np.add.reduceat(corners, starts) / sizes[:, None]
    corners = corners + (1.0 - SPREAD) * (np.repeat(middles, sizes, axis=0) - corners)
    slopes = _slopes(scene, shown, maps, np.repeat(owners, sizes), corners)
    across = slopes[:, 0, 0] * slopes[:, 1, 1] - slopes[:, 0, 1] * slopes[:, 1, 0]
    area = np.add.reduceat(np.abs(across), starts) / sizes
    slopes = np.sqrt(np.add.reduceat(slopes**2, starts) / sizes[:, None, None])
    columns, rows = _subdivisions(slopes, np.maximum(area, 1e-12))
    footprint = _footprint(slopes, columns, rows)
    copies = np.rint(2.0 * np.log2(np.maximum(footprint, 1.0))).astype(int)
    return [
        Strip(surface, side, p, q, nx, ny)
        for surface, side, (p, q), nx, ny in zip(
            shown[owners].tolist(),
            sides,
            copies.tolist(),
            columns.tolist(),
            rows.tolist(),
            strict=True,
        )
    ]


def _slopes(
    scene: Scene, shown: IntArray, maps: FloatArray, owners: IntArray, pixels: FloatArray
) -> FloatArray:
    """Return by how many texels along u, v one moves for a pixel in x, y; shape (K, 2, 2)."""
    maps, (x, y) = maps[owners], pixels.T[:, :, None]
    homogeneous = maps[:, :, 0] * x + maps[:, :, 1] * y + maps[:, :, 2]
    ab, w = homogeneous[:, :2] / homogeneous[:, 2:], homogeneous[:, 2]
    shapes = scene.texture_sizes[shown[owners]]
    shifts = maps[:, :2, :2] - ab[:, :, None] * maps[:, 2:, :2]
    return np.asarray(shifts * (shapes / w[:, None])[:, :, None])


def _footprint(slopes: FloatArray, columns: IntArray, rows: IntArray) -> FloatArray:
    """Return how many texels a part of a pixel spans along u and v, shape (..., K, 2)."""
    return np.asarray(
        np.hypot(slopes[:, :, 0] / columns[..., None], slopes[:, :, 1] / rows[..., None])
    )


def _subdivisions(slopes: FloatArray, area: FloatArray) -> tuple[IntArray, IntArray]:
    """
    Return into how many columns and rows pixels are cut before they are sampled.

    Texture copies are blurred along u and v. A pixel that is a skewed sliver on the texture would
    be blurred far beyond it; its parts are less skewed. Where copies could not be much sharper,
    because the texture is magnified, pixels stay whole.
    """
    columns, rows = SUBDIVISIONS.T[:, :, None]
    blurred = _blurred_area(_footprint(slopes, columns, rows)) * columns * rows
    skew = np.maximum(blurred, MAX_SKEW * np.maximum(area, SHARPEST**2))
    fewest = np.argmax(skew <= skew.min(axis=0) / WORTHWHILE, axis=0)
    return SUBDIVISIONS[fewest, 0], SUBDIVISIONS[fewest, 1]


def _blurred_area(footprint: FloatArray) -> FloatArray:
    """Return the area [texel^2] that the copy for a footprint, shape (..., K, 2), blurs."""
    sides = np.maximum(footprint, SHARPEST)
    return np.asarray(sides[..., 0] * sides[..., 1])
