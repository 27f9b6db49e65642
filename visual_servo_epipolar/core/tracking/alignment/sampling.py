"""Sampling: patches of images by bilinear interpolation."""

import math
from typing import Any, TypeAlias

import cv2
import numpy as np
from numpy.typing import NDArray

from visual_servo_epipolar.core.arrays import FloatArray, Image

RADIUS, LEAST_RADIUS = 10, 6  # patches have 2 radius + 1 pixels a side
USUAL_SIZE = 640 * 480  # of an image: the radius shrinks with smaller ones [px]
FloatImage: TypeAlias = NDArray[np.float32]  # for interpolation, shape (H, W)


def patch_radius(shape: tuple[int, ...]) -> int:
    """
    Return the radius of patches [px] in images of ``shape`` (H, W).

    In a small image a patch of the usual side spans so much of the scene that it lies across
    edges in depth.
    """
    share = min(shape[0] * shape[1] / USUAL_SIZE, 1.0)
    return max(LEAST_RADIUS, round(RADIUS * math.sqrt(share)))


def float_image(image: Image) -> FloatImage:
    """Return ``image`` as float32, which OpenCV interpolates without rounding."""
    return np.asarray(image.astype(np.float32))


def bilinear(image: FloatImage, x: NDArray[Any], y: NDArray[Any]) -> FloatImage:
    """
    Sample ``image``, float32 of shape (H, W), at ``x`` and ``y`` [px], shape (M, P) each.

    Points outside take the value of the border. OpenCV 5 interpolates float images exactly; of
    8-bit ones it rounds the result, which costs a hundredth of a pixel.
    """
    x, y = x.astype(np.float32, copy=False), y.astype(np.float32, copy=False)
    sampled = cv2.remap(image, x, y, cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE)
    return np.asarray(sampled, dtype=np.float32)


class PatchGrid:
    """Patch grid: the offsets (x, y) of a square patch, 2 ``reach`` + 1 pixels a side."""

    def __init__(self, reach: int) -> None:
        self.reach = reach
        side = np.arange(-reach, reach + 1, dtype=np.float64)
        self.offsets = np.stack(np.meshgrid(side, side), axis=-1).reshape(-1, 2)
        homogeneous = np.column_stack([self.offsets, np.ones(len(self.offsets))])
        self._rows = homogeneous.T.astype(np.float32)

    def sample(self, image: FloatImage, centre: FloatArray, local: FloatArray) -> FloatImage:
        """
        Return the patches of ``image`` around N ``centre``, shape (N, 2) [px], shape (N, P).

        ``local``, shape (N, 2, 2), maps offsets in the patch to those in the image.
        """
        # One product for all of them: the rows of x, then those of y.
        maps = np.empty((2, len(centre), 3), np.float32)
        maps[:, :, :2], maps[:, :, 2] = local.transpose(1, 0, 2), centre.T
        x, y = (maps.reshape(-1, 3) @ self._rows).reshape(2, len(centre), -1)
        return bilinear(image, x, y)
