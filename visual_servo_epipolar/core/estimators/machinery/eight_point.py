"""
Hartley's normalised 8-point algorithm: F of any motion from eight matches or more.

As in the paper it works on image-plane points: pixels, or (x/z, y/z) of rays in front.
"""

import math

import numpy as np

from visual_servo_epipolar.core.arrays import as_points, FloatArray
from visual_servo_epipolar.core.errors import DegenerateGeometryError
from visual_servo_epipolar.core.geometry.rays import homogeneous

MIN_MATCHES = 8


def hartley_normalisation(points: FloatArray) -> FloatArray:
    """Return T, shape (3, 3): centroid to the origin, mean distance to sqrt(2) (Hartley 1995)."""
    centre = points.mean(axis=0)
    spread = float(np.sqrt(((points - centre) ** 2).sum(axis=1)).mean())
    if not spread > 0.0:
        raise DegenerateGeometryError(
            f'{len(points)} points coincide at {centre}; track features spread over the image'
        )
    scale = math.sqrt(2.0) / spread
    return np.array(
        [[scale, 0.0, -scale * centre[0]], [0.0, scale, -scale * centre[1]], [0.0, 0.0, 1.0]]
    )


def design_matrix(current: FloatArray, desired: FloatArray) -> FloatArray:
    """Return the rows a with a . vec(F) = p_d^T F p_a, shape (N, 9), F by rows."""
    p_current, p_desired = homogeneous(current), homogeneous(desired)
    return (p_desired[:, :, None] * p_current[:, None, :]).reshape(-1, 9)


def fundamental_from_matches(current: FloatArray, desired: FloatArray) -> FloatArray:
    """
    Return F of rank 2 by the normalised 8-point algorithm, shape (3, 3), Frobenius norm 1.

    Parameters
    ----------
    current, desired : arrays, shape (N, 2)
        At least eight matches, in pixels or as (x/z, y/z); F is for the same unit.

    Raises
    ------
    DegenerateGeometryError
        With fewer than eight matches, or points that coincide.

    """
    current, desired = as_points(current, 'current'), as_points(desired, 'desired')
    if len(current) != len(desired) or len(current) < MIN_MATCHES:
        raise DegenerateGeometryError(
            f'the 8-point algorithm needs at least {MIN_MATCHES} matches, got {len(current)} '
            f'current and {len(desired)} desired points; track more features'
        )
    to_current, to_desired = hartley_normalisation(current), hartley_normalisation(desired)
    rows = design_matrix(transform(to_current, current), transform(to_desired, desired))
    solution = np.linalg.svd(rows, full_matrices=True)[2][-1].reshape(3, 3)
    fundamental = to_desired.T @ rank_two(solution) @ to_current
    return np.asarray(fundamental / np.linalg.norm(fundamental))


def transform(matrix: FloatArray, points: FloatArray) -> FloatArray:
    """Return affine ``matrix``, shape (3, 3), applied to ``points``, shape (N, 2)."""
    return np.asarray(points @ matrix[:2, :2].T + matrix[:2, 2])


def rank_two(fundamental: FloatArray) -> FloatArray:
    """Return the closest matrix of rank 2 in Frobenius norm."""
    u, singular, vt = np.linalg.svd(fundamental)
    return np.asarray((u[:, :2] * singular[:2]) @ vt[:2])
