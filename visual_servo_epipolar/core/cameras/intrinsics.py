"""Intrinsics: K as calibrations and CameraInfo write it, checked for plausibility."""

from collections.abc import Sequence
from dataclasses import dataclass
import math

import numpy as np

from visual_servo_epipolar.core.arrays import BoolArray, FloatArray

ROUND_TRIP_PX = 0.1  # that a pixel may be off where it comes back: half of what tracking is
ZERO_PX, ZERO_PER_PX = 1e-6, 1e-9  # what rounding leaves where K has a zero
ZERO_SHARE = 1e-9  # the same where it has a one, of the largest number


@dataclass(frozen=True, slots=True)
class ImageIntrinsics:
    """
    What cameras are made of: image size, focal lengths, principal point [px], distortion, skew.

    ``skew`` s is K[1]: u = fx x + s y + cx [px], behind the distortion. Pixel coordinates (u, v)
    are OpenCV's: u right, v down, integers at pixel centres.
    """

    width: int
    height: int
    fx: float
    fy: float
    cx: float
    cy: float
    distortion: tuple[float, ...] = ()
    distortion_model: str = ''
    skew: float = 0.0

    def __post_init__(self) -> None:
        if min(self.width, self.height) < 1:
            raise ValueError(
                f'image size must be positive, got {self.width}x{self.height}; '
                'check width and height of the CameraInfo'
            )
        intrinsics = (self.fx, self.fy, self.cx, self.cy, self.skew, *self.distortion)
        if not all(math.isfinite(value) for value in intrinsics):
            raise ValueError(f'intrinsics must be finite, got {intrinsics}; calibrate the camera')
        if min(self.fx, self.fy) <= 0.0:
            raise ValueError(
                f'focal lengths must be positive, got fx {self.fx} and fy {self.fy} px: '
                'K[0] = 0 means an uncalibrated camera; calibrate it and set its CameraInfo'
            )

    @property
    def matrix(self) -> FloatArray:
        """K as in CameraInfo, shape (3, 3): the intrinsic matrix of a pinhole (eq. 2)."""
        return np.array([[self.fx, self.skew, self.cx], [0.0, self.fy, self.cy], [0.0, 0.0, 1.0]])

    @property
    def lens(self) -> str:
        """Name of the lens, for messages."""
        return self.distortion_model

    @property
    def focal(self) -> float:
        """Pixels per rad at the centre."""
        return math.sqrt(self.fx * self.fy)

    def contains(self, pixels: FloatArray, *, margin: float = 0.0) -> BoolArray:
        """Return which ``pixels``, shape (N, 2), lie in the image, ``margin`` [px] inside."""
        u, v = pixels[:, 0], pixels[:, 1]
        inside_u = (u >= margin) & (u <= self.width - 1 - margin)
        return np.asarray(inside_u & (v >= margin) & (v <= self.height - 1 - margin))


def sheared(camera: ImageIntrinsics, pixels: FloatArray, skew: float) -> FloatArray:
    """Return ``pixels``, shape (N, 2), with ``skew`` [px], that of the camera or its opposite."""
    if skew == 0.0:
        return pixels
    u, v = pixels[:, 0], pixels[:, 1]
    return np.column_stack([u + (v - camera.cy) * (skew / camera.fy), v])


def checked_matrix(numbers: Sequence[float], name: str = 'K') -> FloatArray:
    """
    Return the three columns of K (nine numbers by rows) or P (twelve) that make pixels, (3, 3).

    Rows are (fx, s, cx), (0, fy, cy), (0, 0, 1) up to a common factor, which is divided out.

    Raises
    ------
    ValueError
        If they are not, as in a matrix that is written by columns.

    """
    rows = np.array(numbers, dtype=np.float64).reshape(3, -1)
    if not np.isfinite(rows).all():
        raise ValueError(f'intrinsics must be finite, {name} is {rows.tolist()}; calibrate')
    if not rows.any():  # an uncalibrated camera
        return rows[:, :3]
    matrix = _normalised(rows)
    if matrix is not None:
        return matrix
    values = ', '.join(f'{value:g}' for value in numbers)
    expected = '(fx, s, cx), (0, fy, cy), (0, 0, 1)'
    if _normalised(rows.reshape(-1, 3).T) is not None:
        raise ValueError(
            f'{name} is transposed: its rows must be {expected}, got {values}, which are its '
            f'columns; write {name} row by row'
        )
    raise ValueError(
        f'the rows of {name} must be {expected}, got {values}; calibrate, or mend its writer'
    )


def _normalised(rows: FloatArray) -> FloatArray | None:
    """Return the left part of ``rows``, (3, 3), with a last row 0, 0, 1; None if it has none."""
    if abs(rows[2, 2]) <= ZERO_SHARE * np.abs(rows).max():
        return None
    rows = rows / rows[2, 2]
    last = np.abs(np.delete(rows[2], 2))
    is_whole = abs(rows[1, 0]) <= ZERO_PX and last.max() <= ZERO_PER_PX
    return rows[:, :3] if is_whole else None
