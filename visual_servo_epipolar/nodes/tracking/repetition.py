"""Repetition of images: a driver may stamp its last one anew for ever, or one of another time."""

from collections import deque
import zlib

import numpy as np

from visual_servo_epipolar.core.arrays import Image

KEPT = 64  # images that are known again: six seconds of them
ROWS = 8  # of so many one is looked at, which costs 0.1 ms where there are 1280x1024 px


class Repetition:
    """
    How many images in a row have been the very same, to the last bit, and whether one came before.

    ``back`` is how many images ago the newest one came last, 0 if it is new.
    """

    def __init__(self) -> None:
        self._last: Image | None = None
        self._kept: deque[object] = deque(maxlen=KEPT)  # the newest first
        self.count, self.back = 0, 0

    def see(self, image: Image | None) -> int:
        """Take the next image, None if it could not be read, and return the count."""
        known = None if image is None else _fingerprint(image)
        again = bool(self._kept) and known == self._kept[0] and self._is_last(image)
        self._last, self.count = image, self.count + 1 if again else 0
        self.back = 0
        if known is not None and known in self._kept:
            self.back = self._kept.index(known) + 1
        self._kept.appendleft(known)
        return self.count

    def _is_last(self, image: Image | None) -> bool:
        """Return whether an image is the last one, pixel by pixel."""
        return image is not None and self._last is not None and np.array_equal(image, self._last)


def _fingerprint(image: Image) -> tuple[tuple[int, ...], int]:
    """Return what two images that are not the very same hardly ever share."""
    return image.shape, zlib.crc32(np.ascontiguousarray(image[::ROWS]).data)
