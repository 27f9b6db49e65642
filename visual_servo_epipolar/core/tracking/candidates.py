"""
Candidates: features of the desired view that are worth tracking, and the order of search.

They are spread over the image by bucketing: of the cells of a grid the best of each, then the
second best.
"""

import math

import numpy as np

from visual_servo_epipolar.core.arrays import are_among, BoolArray, FloatArray, IntArray
from visual_servo_epipolar.core.tracking.matching import DesiredView, Matches, warps_of
from visual_servo_epipolar.core.tracking.tracks import Tracks
from visual_servo_epipolar.core.tracking.warps import Warps

GRID = (4, 3)  # columns and rows of the coarse grid that measures coverage
INFORMATIVE_HEIGHT = 0.25  # of half the image: nearer to the horizon a feature counts for less
FULL_PERIOD = 3  # with a full set a search is made once in so many frames, for as much less
# Candidates tried in a frame for each feature that is missing: eight took as long as all else.
TRIES = 3
# Deviation by noise of a strong feature [px]: weaker ones are tracked where these do not suffice.
STRONG = 0.03
SPARSE = 2  # features in a cell of the desired image that is hardly covered


class Candidates:
    """Candidates: the features of one desired view that could be matched at least once."""

    def __init__(self, view: DesiredView) -> None:
        self._view, self._is_strong = view, view.deviations <= STRONG
        self._cells = cells(view.keypoints.pixels, self.size)
        self._ids: IntArray = np.empty(0, np.int64)
        self._next, self._frames = 0, 0
        self._due = 0  # candidates yet to be tried for what was missing

    @property
    def size(self) -> tuple[int, int]:
        """Width and height of the desired image [px]."""
        height, width = self._view.image.shape
        return width, height

    def remember(self, ids: IntArray, limit: int) -> None:
        """Add features ``ids``, shape (M,); of all keep at most ``limit``, older ones first."""
        union: IntArray = np.asarray(np.union1d(self._ids, ids), dtype=np.int64)
        self._ids = union[self.bucketed(union, are_among(union, self._ids), limit)]

    def bucketed(self, ids: IntArray, preferred: BoolArray, count: int) -> IntArray:
        """
        Choose at most ``count`` of ``ids``, shape (N,), spread over the desired image.

        ``preferred`` ones, shape (N,), and strong ones come before weak ones; within a cell
        preferred ones and good corners. Returns the chosen rows in ascending order.
        """
        pixels, (width, height) = self._view.keypoints.pixels[ids], self.size
        # What lies at the height of the camera hardly moves in a planar motion.
        height_share = np.abs(pixels[:, 1] - 0.5 * height) / (0.5 * height)
        quality = self._view.corners[ids] * np.minimum(height_share / INFORMATIVE_HEIGHT, 1.0)
        strong = preferred | self._is_strong[ids]
        quality = quality + (1.0 * strong + preferred) * self._view.corners.max()
        columns = max(2, round((1.5 * count) ** 0.5))
        rows = max(2, round(columns * height / width))
        rank = _rank_in_cell(cells(pixels, self.size, grid=(columns, rows)), quality)
        best_first = np.lexsort((-quality, rank, ~strong))
        return np.sort(best_first[:count])

    def matched(self, matches: Matches, tracked: Warps, limit: int) -> Warps:
        """Return the warps of at most ``limit`` matches that are not ``tracked``, spread."""
        rows = np.flatnonzero(~are_among(matches.indices, tracked.ids))
        rows = rows[self.bucketed(matches.indices[rows], np.zeros(len(rows), bool), limit)]
        return warps_of(matches, self._view).take(rows)

    def limited(self, tracks: Tracks, preferred: Tracks, limit: int) -> Tracks:
        """Return at most ``limit`` of ``tracks``, spread, ``preferred`` ones first."""
        ids = tracks.warps.ids
        first = are_among(ids, preferred.warps.ids)
        return tracks.take(self.bucketed(ids, first, limit))

    def next_missing(self, tracked: Warps, count: int, enough: int) -> IntArray:
        """
        Return the next candidates that are not ``tracked``, in turn, by id, ``count`` at most.

        This is called once a frame. Where few are missing from ``enough``, the ``count`` are
        spread over several frames. After them, only candidates in sparse cells of the desired
        image are tried, fewer, and not in every frame.
        """
        self._frames += 1
        short = max(enough - len(tracked), 0)
        self._due = count if short else min(self._due, count)
        is_full = not (short or self._due)
        if is_full and self._frames % FULL_PERIOD:
            return self._ids[:0]
        missing = self._ids[~are_among(self._ids, tracked.ids)]
        if is_full:
            occupied = np.bincount(self._cells[tracked.ids], minlength=math.prod(GRID))
            missing = missing[occupied[self._cells[missing]] <= SPARSE]
            count = max(count // FULL_PERIOD, 1)
        else:
            count = min(self._due, TRIES * max(short, 1))
            self._due -= count
        count = min(count, len(missing))
        if count == 0:
            return missing[:0]
        ids = np.take(missing, self._next + np.arange(count), mode='wrap')
        self._next = (self._next + count) % len(missing)
        return ids


def cells(pixels: FloatArray, size: tuple[int, int], *, grid: tuple[int, int] = GRID) -> IntArray:
    """Return the cell of each of ``pixels``, (N, 2), in an image of width and height ``size``."""
    columns, rows = grid
    column = np.clip(pixels[:, 0] * columns / size[0], 0, columns - 1).astype(np.int64)
    row = np.clip(pixels[:, 1] * rows / size[1], 0, rows - 1).astype(np.int64)
    return np.asarray(row * columns + column)


def _rank_in_cell(cell: IntArray, quality: FloatArray) -> IntArray:
    """Return the rank of each point by ``quality`` among those of its ``cell``, shape (N,)."""
    order = np.lexsort((-quality, cell))
    starts = np.flatnonzero(np.diff(cell[order], prepend=-1))
    sizes = np.diff(starts, append=len(order))
    rank = np.empty(len(order), np.int64)
    rank[order] = np.arange(len(order)) - np.repeat(starts, sizes)
    return rank
