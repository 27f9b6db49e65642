"""Sampling: patches of images by bilinear interpolation."""

import math
from typing import TypeAlias

import cv2
import numpy as np
from numpy.typing import NDArray

from visual_servo_epipolar.core.arrays import BoolArray, FloatArray, Image, NORMAL
from visual_servo_epipolar.core.geometry.rays import homogeneous

RADIUS, LEAST_RADIUS = 10, 6  # patches have 2 radius + 1 pixels a side
USUAL_SIZE = 640 * 480  # of an image: the radius shrinks with smaller ones [px]
COMPARED = 500  # features with which all are compared, to see how they overlap, or lie
NOISE_ROWS, NOISE_SAMPLES = 24, 8000  # of an image, from which its noise is measured
LEAST_NOISE = 0.5  # of rounding, and of a picture that was compressed [grey levels]
FloatImage: TypeAlias = NDArray[np.float32]  # for interpolation, shape (H, W)


def patch_radius(shape: tuple[int, ...]) -> int:
    """
    Return the radius of patches [px] in images of ``shape`` (H, W).

    In a small image a patch of the usual side spans so much of the scene that it lies across
    edges in depth.
    """
    share = min(shape[0] * shape[1] / USUAL_SIZE, 1.0)
    return max(LEAST_RADIUS, round(RADIUS * math.sqrt(share)))


def patches_for_one(shape: tuple[int, ...]) -> float:
    """Return how many patches of an image of ``shape`` (H, W) have the pixels of a usual one."""
    return ((2 * RADIUS + 1) / (2 * patch_radius(shape) + 1)) ** 2


def overlap(pixels: FloatArray, shape: tuple[int, ...]) -> float:
    """
    Return how many features at ``pixels``, (N, 2), of an image of ``shape`` count as one.

    Patches that overlap have the noise of the same pixels: errors of two of them correlate by the
    share of the area that they have in common. Features are independent where that is 1.
    """
    side = 2.0 * patch_radius(shape) + 1.0
    some = pixels[:: max(len(pixels) // COMPARED, 1)]
    across, along = (
        np.maximum(1.0 - np.abs(some[:, None, k] - pixels[:, k]) / side, 0.0) for k in (0, 1)
    )
    return float((across * along).sum() / max(len(some), 1))


def float_image(image: Image) -> FloatImage:
    """Return ``image`` as float32, which OpenCV interpolates without rounding."""
    return np.asarray(image.astype(np.float32))


def noise(image: Image) -> float:
    """
    Return the deviation of the noise of ``image``, uint8 of shape (H, W) [grey levels].

    By the median of second differences (Immerkaer 1996), which few edges reach, of pixels that
    are neither black nor white; never less than LEAST_NOISE.
    """
    height, width = image.shape
    if min(height, width) < 3:
        return LEAST_NOISE
    rows = np.linspace(1, height - 2, min(NOISE_ROWS, height - 2)).astype(int)
    above, here, below = (image[rows + step].astype(np.int16) for step in (-1, 0, 1))
    across = above - 2 * here + below
    differences = across[:, :-2] - 2 * across[:, 1:-1] + across[:, 2:]
    centre = here[:, 1:-1]
    stride = differences.size // NOISE_SAMPLES + 1
    differences = np.abs(differences[(centre > 0) & (centre < 255)][::stride])
    deviation = NORMAL / 6.0 * float(np.median(differences)) if len(differences) else 0.0
    return max(deviation, LEAST_NOISE)


def bilinear(image: FloatImage, x: FloatImage, y: FloatImage) -> FloatImage:
    """
    Sample ``image``, float32 of shape (H, W), at ``x`` and ``y`` [px], float32 of shape (M, P).

    Points outside take the value of the border. OpenCV 5 interpolates float images exactly; of
    8-bit ones it rounds the result, which costs a hundredth of a pixel.
    """
    sampled = cv2.remap(image, x, y, cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE)
    return np.asarray(sampled, dtype=np.float32)


class PatchGrid:
    """Patch grid: the offsets (x, y) of a square patch, 2 ``reach`` + 1 pixels a side."""

    def __init__(self, reach: int) -> None:
        self.reach = reach
        side = np.arange(-reach, reach + 1, dtype=np.float64)
        self.offsets = np.stack(np.meshgrid(side, side), axis=-1).reshape(-1, 2)
        self._rows = homogeneous(self.offsets).T.astype(np.float32)

    def sample(self, image: FloatImage, maps: FloatArray) -> FloatImage:
        """
        Return N patches of ``image``, shape (N, P).

        ``maps``, shape (N, 2, 3), are the affine maps of offsets in a patch to pixels: the linear
        part, and in the last column the centre [px].
        """
        # One product for all of them: the rows of x, then those of y.
        rows = maps.transpose(1, 0, 2).astype(np.float32, order='C').reshape(-1, 3)
        pixels = rows @ self._rows
        return bilinear(image, pixels[: len(maps)], pixels[len(maps) :])


def affine_maps(linear: FloatArray, centre: FloatArray) -> FloatArray:
    """Return affine maps, (N, 2, 3), of their ``linear`` parts, (N, 2, 2), and centres, (N, 2)."""
    maps = np.empty((len(centre), 2, 3))
    maps[:, :, :2], maps[:, :, 2] = linear, centre
    return maps


def inside_border(pixels: FloatArray, shape: tuple[int, ...], border: float) -> BoolArray:
    """
    Return which of ``pixels``, shape (N, 2), keep ``border`` [px] from the border, shape (N,).

    ``shape`` is height and width of the image [px].
    """
    height, width = shape
    u, v = pixels[:, 0], pixels[:, 1]
    inside = (u >= border) & (u < width - border) & (v >= border) & (v < height - border)
    return np.asarray(inside)
