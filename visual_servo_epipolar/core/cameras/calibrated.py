"""Cameras by the names that CameraInfo and calibration files give their lenses."""

from collections.abc import Sequence
from dataclasses import replace
from typing import TypeAlias

import numpy as np

from visual_servo_epipolar.core.arrays import FloatArray
from visual_servo_epipolar.core.cameras.equidistant import COEFFICIENTS, Equidistant
from visual_servo_epipolar.core.cameras.pinhole import Camera, DISTORTION_MODELS

CalibratedCamera: TypeAlias = Camera | Equidistant
LENSES = (*(name for name in DISTORTION_MODELS if name), 'equidistant')
# Names of the same lenses: of drivers, of Kalibr and of Apex.AI's and Intel's models.
SYNONYMS = {
    'none': '',
    'radtan': 'plumb_bob',
    'radial-tangential': 'plumb_bob',
    'brown_conrady': 'plumb_bob',
    'fisheye': 'equidistant',
    'equi': 'equidistant',
    'kannala_brandt4': 'equidistant',
}
ZERO_PX, ZERO_PER_PX = 1e-6, 1e-9  # what rounding leaves where K has a zero
ZERO_SHARE = 1e-9  # the same where it has a one, of the largest number


def lens_name(distortion_model: str) -> str:
    """Return the name that CameraInfo has for a lens, '' for none; as it is if it is unknown."""
    name = distortion_model.strip().lower()
    return SYNONYMS.get(name, name)


def calibrated_camera(
    size: tuple[int, int],
    k: Sequence[float],
    distortion: tuple[float, ...] = (),
    distortion_model: str = 'plumb_bob',
) -> CalibratedCamera:
    """
    Return the camera of an image ``size`` [px], K by rows (nine numbers) and a named lens.

    Zeros beyond the coefficients of the lens are left out.

    Raises
    ------
    ValueError
        If there is no such camera.

    """
    (fx, skew, cx), (_, fy, cy), _ = checked_matrix(k).tolist()
    name = lens_name(distortion_model)
    if name == 'equidistant':
        kept = _fitting(distortion, COEFFICIENTS)
        return Equidistant(*size, fx, fy, cx, cy, kept, skew=skew)
    kept = _fitting(distortion, DISTORTION_MODELS.get(name, ()))
    return Camera(*size, fx, fy, cx, cy, kept, name, skew)


def scaled(
    camera: CalibratedCamera, size: tuple[int, int], scale_u: float, scale_v: float
) -> CalibratedCamera:
    """Return the camera of its image scaled to ``size`` [px], by these factors along u and v."""
    return replace(
        camera,
        width=size[0],
        height=size[1],
        fx=camera.fx * scale_u,
        skew=camera.skew * scale_u,
        fy=camera.fy * scale_v,
        # Pixel centres are integers: the left border of the image lies at -0.5.
        cx=(camera.cx + 0.5) * scale_u - 0.5,
        cy=(camera.cy + 0.5) * scale_v - 0.5,
    )


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
    if not rows.any():  # a camera that nobody calibrated
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
        f'the rows of {name} must be {expected}, got {values}; calibrate, or mend who writes it'
    )


def _normalised(rows: FloatArray) -> FloatArray | None:
    """Return the left part of ``rows``, (3, 3), with a last row 0, 0, 1; None if it has none."""
    if abs(rows[2, 2]) <= ZERO_SHARE * np.abs(rows).max():
        return None
    rows = rows / rows[2, 2]
    last = np.abs(np.delete(rows[2], 2))
    is_whole = abs(rows[1, 0]) <= ZERO_PX and last.max() <= ZERO_PER_PX
    return rows[:, :3] if is_whole else None


def _fitting(distortion: tuple[float, ...], counts: Sequence[int]) -> tuple[float, ...]:
    """Return ``distortion`` without the zeros beyond the most coefficients that are allowed."""
    fitting = [n for n in counts if n <= len(distortion) and not any(distortion[n:])]
    return distortion[: max(fitting)] if fitting else distortion
