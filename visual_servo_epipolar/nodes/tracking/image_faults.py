"""Faults of the images as they come: late ones, and those that repeat."""

from collections import deque
import zlib

import numpy as np
from rclpy.node import Node

from visual_servo_epipolar.core.arrays import Image
from visual_servo_epipolar.core.stamps import OTHER_CLOCK_S, seconds_between

KEPT = 64  # images that are known again: six seconds of them
ROWS = 8  # of so many one is looked at, which costs 0.1 ms where there are 1280x1024 px


BEHIND_S = 0.5  # age of an image at which its tracks come late
BEHIND_IMAGES = 3  # so many one after the other are no single match of the whole image


class Repetition:
    """How often the newest image came in a row, and how many images ago (``back``), 0 if new."""

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


class Lateness:
    """Lateness of the tracks of ``node``, by the age of each image."""

    def __init__(self, node: Node) -> None:
        self._node = node
        self._late = 0  # images in a row whose tracks came late

    def age_s(self, stamp_ns: int) -> float | None:
        """Return the age of an image [s]; None in simulated time or where another clock stamps."""
        if self._node.get_parameter('use_sim_time').value:
            return None
        age_s = seconds_between(stamp_ns, self._node.get_clock().now().nanoseconds)
        return age_s if abs(age_s) < OTHER_CLOCK_S else None

    def complaint(self, age_s: float | None) -> str:
        """Count an image of this age, and return that tracks come late, and what to do, or ''."""
        self._late = self._late + 1 if age_s is not None and age_s >= BEHIND_S else 0
        if age_s is None or self._late < BEHIND_IMAGES:
            return ''
        return (
            f'the tracker falls behind: the newest image was {age_s:.1f} s old when its tracks '
            'came; send smaller images or fewer, or lower max_features'
        )
