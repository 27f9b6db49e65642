"""An image shown at another size, and where its pixels are then."""

import cv2
import numpy as np

from visual_servo_epipolar.core.arrays import FloatArray, Image


class Resized:
    """
    Map from an image of ``size`` to a picture of ``shown``, both width and height [px].

    Borders stay borders: pixel centres are half a pixel inside of them. Without ``shown`` nothing
    changes.
    """

    def __init__(self, size: tuple[int, int], shown: tuple[int, int] | None) -> None:
        self._shown = None if shown == size else shown
        self._scale = np.array(shown or size) / size

    def image(self, image: Image) -> Image:
        """Return ``image``, shape (H, W, ...), as it is shown."""
        if self._shown is None:
            return image
        # Averaging takes longer by far than interpolation, and is needed for strong shrinking.
        kind = cv2.INTER_AREA if self._scale[1] < 0.5 else cv2.INTER_LINEAR
        return np.asarray(cv2.resize(image, self._shown, interpolation=kind), dtype=np.uint8)

    def points(self, pixels: FloatArray) -> FloatArray:
        """Return where ``pixels``, shape (N, 2), are shown."""
        return (pixels + 0.5) * self._scale - 0.5

    def fundamental(self, fundamental: FloatArray) -> FloatArray:
        """Return F of pixels as they are shown, shape (3, 3); both images are of one size."""
        back = np.diag([*1.0 / self._scale, 1.0])
        back[:2, 2] = 0.5 / self._scale - 0.5
        return np.asarray(back.T @ fundamental @ back)
