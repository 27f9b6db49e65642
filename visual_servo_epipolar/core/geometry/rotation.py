"""Rotation between two views without a baseline, and the parallax that it leaves unexplained."""

from collections.abc import Sequence
from dataclasses import dataclass
import math
from typing import TypeAlias

import numpy as np

from visual_servo_epipolar.core.arrays import FloatArray, median
from visual_servo_epipolar.core.errors import DegenerateGeometryError

ITERATIONS = 6
MIN_POINTS = 3
TRUSTED_SHARE = 0.6  # of the matches that make the parallax: the worst may be outliers
SMALLEST = 1e-18  # squared distance by which weights are scaled at least [rad^2]
TINY = 1e-12  # angle that is divided by [rad]
RIDGE = 1e-12  # keeps the equations of a turn regular where all matches coincide

Entries: TypeAlias = Sequence[float]  # nine, of a matrix of 3 x 3


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
    for _ in range(ITERATIONS - 1):
        carried = rotation @ source
        weights = _squared(target - carried)
        weights /= max(4.0 * median(weights), SMALLEST)
        weights += 1.0
        weights *= weights
        rotation = _turned(rotation, (target / weights) @ carried.T)
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
    nearest = np.asarray(u @ vt)
    if _determinant(nearest.ravel().tolist()) >= 0.0:
        return nearest
    u[:, 2] *= -1.0
    return np.asarray(u @ vt)


def _determinant(entries: Entries) -> float:
    """Return the determinant of a matrix for its entries, row by row: numbers, for speed."""
    xx, xy, xz, yx, yy, yz, zx, zy, zz = entries
    return xx * (yy * zz - yz * zy) - xy * (yx * zz - yz * zx) + xz * (yx * zy - yy * zx)


def _turned(rotation: FloatArray, product: FloatArray) -> FloatArray:
    """
    Return ``rotation`` after one step of Newton towards that of ``_kabsch``, (3, 3).

    ``product`` is the sum of w target (R source)^T, symmetric at the best R. A step leaves an
    error of the square of its length or less: new weights turn R by little, then less and less.
    """
    return np.asarray(np.array(_step(product.ravel().tolist())).reshape(3, 3) @ rotation)


def _step(entries: Entries) -> list[float]:
    """Return the turn of a step for the entries of a product, row by row: numbers, for speed."""
    xx, xy, xz, yx, yy, yz, zx, zy, zz = entries
    pull_x, pull_y, pull_z = zy - yz, xz - zx, yx - xy  # the sum of w (R source) x target
    size = (1.0 + RIDGE) * (xx + yy + zz)
    a, b, c = size - xx, size - yy, size - zz
    d, e, f = -0.5 * (xy + yx), -0.5 * (xz + zx), -0.5 * (yz + zy)
    # By the adjugate of the symmetric stiffness [[a, d, e], [d, b, f], [e, f, c]].
    aa, ab, ac = b * c - f * f, e * f - d * c, d * f - b * e
    bb, bc, cc = a * c - e * e, d * e - a * f, a * b - d * d
    half = 0.5 / (a * aa + d * ab + e * ac)
    x = half * (aa * pull_x + ab * pull_y + ac * pull_z)
    y = half * (ab * pull_x + bb * pull_y + bc * pull_z)
    z = half * (ac * pull_x + bc * pull_y + cc * pull_z)
    # Cayley's map is a rotation whatever the length of the step.
    whole = 1.0 / (1.0 + x * x + y * y + z * z)
    rest, twice = 2.0 * whole - 1.0, 2.0 * whole
    return [
        *(rest + twice * x * x, twice * (x * y - z), twice * (x * z + y)),
        *(twice * (x * y + z), rest + twice * y * y, twice * (y * z - x)),
        *(twice * (x * z - y), twice * (y * z + x), rest + twice * z * z),
    ]
