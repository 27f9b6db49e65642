"""What every camera can do: turn pixels into rays and back."""

from collections.abc import Sequence
import math
from typing import Protocol

import numpy as np

from visual_servo_epipolar.core.arrays import BoolArray, FloatArray

ROUND_TRIP_PX = 0.1  # that a pixel may be off where it comes back: half of what tracking is


class CameraModel(Protocol):
    """
    A camera: unit rays of pixels, pixels of unit rays.

    Pixel coordinates (u, v) are OpenCV's: u right, v down, integers at pixel centres. Camera axes:
    x right, y down, z forward; a lens may see rays behind, z < 0. ``focal`` [px per rad at the
    centre] only turns thresholds in pixels into angles. Equal cameras are equal values.
    """

    @property
    def width(self) -> int:
        """Width of the image [px]."""
        ...

    @property
    def height(self) -> int:
        """Height of the image [px]."""
        ...

    @property
    def focal(self) -> float:
        """Pixels per rad at the centre."""
        ...

    @property
    def lens(self) -> str:
        """Name of the lens, for messages."""
        ...

    @property
    def wide(self) -> bool:
        """Whether it sees farther off its axis than an image plane can well hold."""
        ...

    @property
    def edges(self) -> tuple[float, float]:
        """Bearings of the left and of the right edge of the image [rad], right positive."""
        ...

    def rays(self, pixels: FloatArray) -> FloatArray:
        """Return unit rays, (N, 3), of ``pixels``, (N, 2), not finite where there are none."""
        ...

    def pixels(self, rays: FloatArray) -> FloatArray:
        """Return the pixels, shape (N, 2), of ``rays``, shape (N, 3); nan for those not seen."""
        ...

    def round_trips(self, pixels: FloatArray, rays: FloatArray) -> BoolArray:
        """
        Return which ``pixels``, shape (N, 2), come back from their ``rays``, (N, 3): (N,).

        A pixel that does not lies where the distortion of the lens cannot be undone.
        """
        ...

    def resolution(self, rays: FloatArray) -> FloatArray:
        """
        Return the angle of a pixel at each of ``rays``, shape (N, 3): (N,) [rad].

        It is the square root of its solid angle: the deviation of the angle of a ray, along
        either of two axes across it, where pixels have a deviation of one.
        """
        ...

    def contains(self, pixels: FloatArray, *, margin: float = 0.0) -> BoolArray:
        """Return which ``pixels``, shape (N, 2), lie in the image, ``margin`` [px] inside."""
        ...


class Intrinsics(Protocol):
    """The numbers of K [px]."""

    @property
    def fx(self) -> float:
        """Focal length along u."""
        ...

    @property
    def fy(self) -> float:
        """Focal length along v."""
        ...

    @property
    def cx(self) -> float:
        """Principal point, u."""
        ...

    @property
    def cy(self) -> float:
        """Principal point, v."""
        ...

    @property
    def skew(self) -> float:
        """Skew: u = fx x + skew y + cx."""
        ...


def intrinsic_matrix(camera: Intrinsics) -> FloatArray:
    """Return K, shape (3, 3)."""
    return np.array(
        [[camera.fx, camera.skew, camera.cx], [0.0, camera.fy, camera.cy], [0.0, 0.0, 1.0]]
    )


def sheared(camera: Intrinsics, pixels: FloatArray, skew: float) -> FloatArray:
    """Return ``pixels``, shape (N, 2), with ``skew`` [px], that of the camera or its opposite."""
    if skew == 0.0:
        return pixels
    u, v = pixels[:, 0], pixels[:, 1]
    return np.column_stack([u + (v - camera.cy) * (skew / camera.fy), v])


def refuse_impossible(
    size: tuple[int, int], focal: tuple[float, float], others: Sequence[float]
) -> None:
    """Raise ValueError for a size of the image, focal lengths or numbers that cannot be."""
    if min(size) < 1:
        raise ValueError(
            f'image size must be positive, got {size[0]}x{size[1]}; '
            'check width and height of the CameraInfo'
        )
    intrinsics = (*focal, *others)
    if not all(math.isfinite(value) for value in intrinsics):
        raise ValueError(f'intrinsics must be finite, got {intrinsics}; calibrate the camera')
    if min(focal) <= 0.0:
        raise ValueError(
            f'focal lengths must be positive, got fx {focal[0]} and fy {focal[1]} px: '
            'K[0] = 0 means an uncalibrated camera; calibrate it and set its CameraInfo'
        )
