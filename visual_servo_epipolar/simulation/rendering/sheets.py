"""Large pictures of which little is looked at: made tile by tile, when somebody is to look."""

from collections.abc import Callable
from typing import TypeAlias

import cv2
import numpy as np

from visual_servo_epipolar.core.arrays import Image

TILE = 256  # side of a tile, even [texel]
Box: TypeAlias = tuple[int, int, int, int]  # left, top, right, bottom, the last two exclusive


class Sheet:
    """
    A picture of ``shape``, (H, W), whose tiles ``make`` gives, by boxes that consist of tiles.

    Each pixel depends on its place alone, not on the boxes it was made in.
    """

    def __init__(self, shape: tuple[int, int], make: Callable[[Box], Image]) -> None:
        self.shape, self._make = shape, make
        self._picture: Image = np.empty(shape, np.uint8)  # takes no memory until it is written to
        self._missing = np.ones([-(-side // TILE) for side in shape], bool)
        self._looked_at: set[Box] = set()  # boxes of tiles that are made

    @classmethod
    def of(cls, image: Image) -> 'Sheet':
        """Return a sheet of a picture that is there."""
        sheet = cls.__new__(cls)
        sheet.shape, sheet._picture = (image.shape[0], image.shape[1]), image
        sheet._missing, sheet._looked_at = np.zeros((0, 0), bool), set()
        return sheet

    def made(self, box: Box) -> Image:
        """Return the picture, shape (H, W), made at least in ``box``, inside of it."""
        left, top, right, bottom = box
        tiles = left // TILE, top // TILE, -(-right // TILE), -(-bottom // TILE)
        if tiles not in self._looked_at:  # five times as fast as to look at the tiles
            missing = self._missing[tiles[1] : tiles[3], tiles[0] : tiles[2]]
            if missing.any():
                self._fill(tiles[1], tiles[0], missing)
            self._looked_at.add(tiles)
        return self._picture

    def whole(self) -> Image:
        """Return the picture, shape (H, W), all of it made."""
        return self.made((0, 0, self.shape[1], self.shape[0]))

    def part(self, box: Box) -> Image:
        """Return what is in ``box``; beyond the border the pixels of the border are repeated."""
        left, top, right, bottom = box
        rows, columns = self.shape
        inside = max(left, 0), max(top, 0), min(right, columns), min(bottom, rows)
        part = self.made(inside)[inside[1] : inside[3], inside[0] : inside[2]]
        if inside == box:
            return part
        beyond = inside[1] - top, bottom - inside[3], inside[0] - left, right - inside[2]
        framed = cv2.copyMakeBorder(part, *beyond, cv2.BORDER_REPLICATE)
        return np.asarray(framed, dtype=np.uint8)

    def _fill(self, row: int, column: int, missing: Image) -> None:
        """Make the box around the tiles that are ``missing`` from tile (row, column) on."""
        rows, columns = (np.flatnonzero(missing.any(axis=axis)) for axis in (1, 0))
        top, left = TILE * (row + int(rows[0])), TILE * (column + int(columns[0]))
        bottom = min(TILE * (row + int(rows[-1]) + 1), self.shape[0])
        right = min(TILE * (column + int(columns[-1]) + 1), self.shape[1])
        self._picture[top:bottom, left:right] = self._make((left, top, right, bottom))
        missing[rows[0] : rows[-1] + 1, columns[0] : columns[-1] + 1] = False
