"""Bucketing: points chosen evenly over an image, the best of each cell of a grid first."""

import numpy as np

from visual_servo_epipolar.core.arrays import BoolArray, FloatArray, IntArray

GRID = (4, 3)  # columns and rows of the coarse grid that measures coverage
CELLS = GRID[0] * GRID[1]


def cells(pixels: FloatArray, size: tuple[int, int], *, grid: tuple[int, int] = GRID) -> IntArray:
    """
    Return the cell of each of ``pixels``, shape (N, 2), row by row from 0, shape (N,).

    ``size`` is width and height of the image [px], ``grid`` its columns and rows of cells.
    """
    columns, rows = grid
    column = np.clip(pixels[:, 0] * columns / size[0], 0, columns - 1).astype(np.int64)
    row = np.clip(pixels[:, 1] * rows / size[1], 0, rows - 1).astype(np.int64)
    return np.asarray(row * columns + column)


def bucketed(
    pixels: FloatArray, quality: FloatArray, strong: BoolArray, count: int, size: tuple[int, int]
) -> IntArray:
    """
    Choose ``count`` points spread over an image: the best of every cell, then the second best.

    Those that are not ``strong`` only where these do not suffice.

    Parameters
    ----------
    pixels : array, shape (N, 2)
        Candidates.
    quality : array, shape (N,)
        Larger is better.
    strong : array, shape (N,)
        Which are chosen before all others.
    count : int
        How many to choose; all when there are not so many.
    size : (int, int)
        Width and height of the image [px].

    Returns
    -------
    indices : array, shape (min(N, count),)
        The chosen rows in ascending order.

    """
    columns = max(2, round((1.5 * count) ** 0.5))
    rows = max(2, round(columns * size[1] / size[0]))
    rank = _rank_in_cell(cells(pixels, size, grid=(columns, rows)), quality)
    best_first = np.lexsort((-quality, rank, ~strong))
    return np.sort(best_first[:count])


def _rank_in_cell(cell: IntArray, quality: FloatArray) -> IntArray:
    """Return the rank of each point by ``quality`` among those of its ``cell``, shape (N,)."""
    order = np.lexsort((-quality, cell))
    starts = np.flatnonzero(np.diff(cell[order], prepend=-1))
    sizes = np.diff(starts, append=len(order))
    rank = np.empty(len(order), np.int64)
    rank[order] = np.arange(len(order)) - np.repeat(starts, sizes)
    return rank
