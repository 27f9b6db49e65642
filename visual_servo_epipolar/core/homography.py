"""Rotation between two views without a baseline, and the parallax that it leaves unexplained."""

from dataclasses import dataclass
import math

import numpy as np

from visual_servo_epipolar.core.arrays import FloatArray
from visual_servo_epipolar.core.epipolar import homogeneous
from visual_servo_epipolar.core.errors import DegenerateGeometryError

ITERATIONS = 6
MIN_POINTS = 3
TRUSTED_SHARE = 0.6  # of the matches that make the parallax: the worst may be outliers


@dataclass(frozen=True, slots=True)
class RotationFit:
    """
    Best rotation R current -> desired, its heading error [rad] and the parallax it leaves.

    ``parallax`` is a robust root mean square, in the unit of rays (times f: pixels).
    """

    rotation: FloatArray
    heading_error: float
    parallax: float


def unit_rays(rays: FloatArray) -> FloatArray:
    """Return ``rays`` (x/z, y/z), shape (N, 2), as unit vectors, shape (N, 3)."""
    solid = homogeneous(rays)
    return np.asarray(solid / np.linalg.norm(solid, axis=1, keepdims=True))


def fit_rotation(current: FloatArray, desired: FloatArray) -> RotationFit:
    """
    Fit the infinite homography: the rotation alone that best carries one view into the other.

    Weighted Kabsch alignment of the rays, reweighted (Geman-McClure) so that outliers and the few
    near features with large parallax do not turn it. The remark closing section IV-B of the paper.

    Raises
    ------
    DegenerateGeometryError
        With fewer than three matches.

    """
    if len(current) < MIN_POINTS:
        raise DegenerateGeometryError(
            f'a rotation needs at least {MIN_POINTS} matches, got {len(current)}; track more'
        )
    from_current, to_desired = unit_rays(current), unit_rays(desired)
    weights = np.ones(len(current))
    for _ in range(ITERATIONS):
        rotation = _kabsch(from_current, to_desired, weights)
        error = np.linalg.norm(to_desired - from_current @ rotation.T, axis=1)
        scale = max(float(np.median(error)) * 2.0, 1e-9)
        weights = 1.0 / (1.0 + (error / scale) ** 2) ** 2
    trimmed = np.sort(error)[: max(MIN_POINTS, int(TRUSTED_SHARE * len(error)))]
    return RotationFit(
        rotation,
        math.atan2(rotation[2, 0] - rotation[0, 2], rotation[0, 0] + rotation[2, 2]),
        float(np.sqrt((trimmed**2).mean())),
    )


def _kabsch(source: FloatArray, target: FloatArray, weights: FloatArray) -> FloatArray:
    u, _, vt = np.linalg.svd((target * weights[:, None]).T @ source)
    sign = np.sign(np.linalg.det(u @ vt))
    return np.asarray((u * [1.0, 1.0, sign]) @ vt)
