"""Repetition of images: a camera that hangs may stamp its last one anew for ever."""

import numpy as np

from visual_servo_epipolar.core.arrays import Image


class Repetition:
    """How many images in a row have been the very same, to the last bit."""

    def __init__(self) -> None:
        self._last: Image | None = None
        self.count = 0

    def see(self, image: Image | None) -> int:
        """Take the next image, None if it could not be read, and return the count."""
        again = image is not None and self._last is not None and np.array_equal(image, self._last)
        self._last, self.count = image, self.count + 1 if again else 0
        return self.count
