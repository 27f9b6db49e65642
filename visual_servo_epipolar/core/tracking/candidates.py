"""Which features of the desired view are worth tracking, and which to look for next."""

import numpy as np

from visual_servo_epipolar.core.arrays import BoolArray, IntArray
from visual_servo_epipolar.core.tracking.matching import CELLS, cells, DesiredView, spread
from visual_servo_epipolar.core.tracking.template_alignment import Warps

INFORMATIVE_HEIGHT = 0.25  # of half the image: nearer to the horizon a feature counts for less
FULL_SHARE = 4  # with a full set only so small a part of the search is made
SPARSE = 2  # features in a part of the desired image that is hardly covered


class Candidates:
    """Features of one desired view that could be matched once: they can be found again."""

    def __init__(self, view: DesiredView) -> None:
        self._view = view
        self._ids: IntArray = np.empty(0, np.int64)
        self._next = 0

    @property
    def size(self) -> tuple[int, int]:
        """Width and height of the desired image [px]."""
        height, width = self._view.image.shape
        return width, height

    def remember(self, ids: IntArray, limit: int) -> None:
        """Add features, and keep at most ``limit`` of all, the older ones first."""
        known: IntArray = np.asarray(np.union1d(self._ids, ids), dtype=np.int64)
        self._ids = known[self.spread(known, np.isin(known, self._ids), limit)]

    def spread(self, ids: IntArray, preferred: BoolArray, count: int) -> IntArray:
        """Choose rows spread over the desired image, ``preferred`` ones and good corners first."""
        pixels, (_, height) = self._view.keypoints.pixels[ids], self.size
        # What lies at the height of the camera hardly moves in a planar motion.
        height_share = np.abs(pixels[:, 1] - 0.5 * height) / (0.5 * height)
        quality = self._view.corners[ids] * np.minimum(height_share / INFORMATIVE_HEIGHT, 1.0)
        quality = quality + preferred * self._view.corners.max()
        return spread(pixels, quality, count, self.size)

    def next_missing(self, tracked: Warps, count: int, enough: int) -> IntArray:
        """
        Return at most ``count`` candidates that are not tracked, other ones at each call.

        With ``enough`` tracked only those from where the desired image is hardly covered any more.
        """
        missing = self._ids[~np.isin(self._ids, tracked.ids)]
        if len(tracked) >= enough:
            occupied = np.bincount(cells(tracked.desired, self.size), minlength=CELLS)
            places = self._view.keypoints.pixels[missing]
            missing = missing[occupied[cells(places, self.size)] <= SPARSE]
            count = max(count // FULL_SHARE, 1)
        count = min(count, len(missing))
        if count == 0:
            return missing[:0]
        keys = np.take(missing, self._next + np.arange(count), mode='wrap')
        self._next = (self._next + count) % len(missing)
        return keys
