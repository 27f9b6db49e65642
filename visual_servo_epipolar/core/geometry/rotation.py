"""Rotation between two views, and the parallax that it leaves."""

from dataclasses import dataclass
import math

import numpy as np

from visual_servo_epipolar.core.arrays import FloatArray, median, TINY
from visual_servo_epipolar.core.errors import DegenerateGeometryError
from visual_servo_epipolar.core.geometry.least_squares import cauchy, REWEIGHTINGS

MIN_POINTS = 3
TRUSTED_SHARE = 0.6  # of the matches, on which parallax and depths rest: others may be wrong


@dataclass(frozen=True, slots=True)
class RotationFit:
    """Best rotation current -> desired, heading error, rms ``parallax`` that it leaves [rad]."""

    rotation: FloatArray
    heading_error: float
    parallax: float


def fit_rotation(current: FloatArray, desired: FloatArray) -> RotationFit:
    """
    Fit the infinite homography: the rotation alone that best carries one view into the other.

    Weighted Kabsch alignment of unit rays, (N, 3), reweighted (Geman-McClure) so that outliers and
    the few near features with large parallax do not turn it. The remark closing section IV-B of
    the paper.

    Raises DegenerateGeometryError with fewer than three matches.
    """
    count = len(current)
    if count < MIN_POINTS:
        raise DegenerateGeometryError(
            f'a rotation needs at least {MIN_POINTS} matches, got {count}; track more'
        )
    source, target = current.T, desired.T
    rotation = _kabsch(target @ current)
    for _ in range(REWEIGHTINGS - 1):
        squares = _squared(target - rotation @ source)
        weight = cauchy(squares, 4.0 * median(squares))
        weight *= weight
        rotation = _kabsch((target * weight) @ current)
    ordered = np.sort(_squared(target - rotation @ source))
    kept = max(MIN_POINTS, int(TRUSTED_SHARE * count))
    parallax = np.sqrt(ordered[:kept].sum() / kept)
    return RotationFit(rotation, float(headings(rotation)), float(parallax))


def headings(rotation: FloatArray) -> FloatArray:
    """Return the heading errors [rad, left positive] of rotations, (..., 3, 3): (...)."""
    sine = rotation[..., 2, 0] - rotation[..., 0, 2]
    return np.asarray(np.arctan2(sine, rotation[..., 0, 0] + rotation[..., 2, 2]))


def rotation_vector(rotation: FloatArray) -> FloatArray:
    """Return axis times angle [rad], shape (3,), of a ``rotation``, (3, 3), below half a turn."""
    (_, xy, xz), (yx, _, yz), (zx, zy, _) = rotation.tolist()
    twice = np.array([zy - yz, xz - zx, yx - xy])  # 2 sin(angle) times the axis
    sine = 0.5 * float(np.linalg.norm(twice))
    angle = math.atan2(sine, 0.5 * (float(np.trace(rotation)) - 1.0))
    return np.asarray(0.5 * twice * (angle / sine if sine > TINY else 1.0))


def rotated(vectors: FloatArray, turns: FloatArray) -> FloatArray:
    """Return ``vectors``, shape (..., 3), rotated by rotation vectors ``turns``, (..., 3)."""
    angles = np.sqrt((turns * turns).sum(axis=-1, keepdims=True))
    axes = turns / np.maximum(angles, TINY)
    along = (axes * vectors).sum(axis=-1, keepdims=True) * axes
    turned = np.cos(angles) * (vectors - along) + np.sin(angles) * np.cross(axes, vectors)
    return np.asarray(along + turned)


def _squared(offset: FloatArray) -> FloatArray:
    """Return the squared lengths of columns, shape (3, N): (N,)."""
    return np.asarray(np.add.reduce(offset * offset, axis=0))


def _kabsch(product: FloatArray) -> FloatArray:
    """Return R that maximises tr(R^T ``product``), the sum of w target source^T, (3, 3)."""
    u, _, vt = np.linalg.svd(product)
    nearest = u @ vt
    if np.linalg.det(nearest) >= 0.0:
        return np.asarray(nearest)
    u[:, 2] *= -1.0
    return np.asarray(u @ vt)
