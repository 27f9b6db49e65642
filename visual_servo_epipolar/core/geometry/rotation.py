"""Rotation between two views without a baseline, and the parallax that it leaves unexplained."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple, TypeAlias

import numpy as np

from visual_servo_epipolar.core.arrays import FloatArray, medians
from visual_servo_epipolar.core.errors import DegenerateGeometryError

ITERATIONS = 6
MIN_POINTS = 3
TRUSTED_SHARE = 0.6  # of the matches that make the parallax: the worst may be outliers
SMALLEST = 1e-18  # squared distance by which weights are scaled at least [rad^2]
RIDGE = 1e-12  # keeps the equations of a turn regular where all matches coincide

Entries: TypeAlias = Sequence[float]  # nine, of a matrix of 3 x 3


@dataclass(frozen=True, slots=True)
class RotationFit:
    """Best rotation current -> desired, heading error, rms ``parallax`` that it leaves [rad]."""

    rotation: FloatArray
    heading_error: float
    parallax: float


class RotationFits(NamedTuple):
    """Best rotations of views, shape (..., 3, 3), heading errors and parallaxes, (...) [rad]."""

    rotation: FloatArray
    heading_error: FloatArray
    parallax: FloatArray


def fit_rotation(current: FloatArray, desired: FloatArray) -> RotationFit:
    """
    Fit the infinite homography: the rotation alone that best carries one view into the other.

    See ``fit_rotations``; unit rays have shape (N, 3).

    Raises DegenerateGeometryError with fewer than three matches.
    """
    rotation, heading_error, parallax = fit_rotations(current, desired)
    return RotationFit(rotation, float(heading_error), float(parallax))


def fit_rotations(current: FloatArray, desired: FloatArray) -> RotationFits:
    """
    Fit the rotation of each pair of views, unit rays of shape (..., N, 3).

    Weighted Kabsch alignment of the rays, reweighted (Geman-McClure) so that outliers and the few
    near features with large parallax do not turn it. The remark closing section IV-B of the paper.

    Raises DegenerateGeometryError with fewer than three matches.
    """
    count = current.shape[-2]
    if count < MIN_POINTS:
        raise DegenerateGeometryError(
            f'a rotation needs at least {MIN_POINTS} matches, got {count}; track more'
        )
    source, target = current.swapaxes(-1, -2), desired.swapaxes(-1, -2)
    rotation = _kabsch(target @ current)
    for _ in range(ITERATIONS - 1):
        carried = rotation @ source
        weights = _squared(target - carried)
        weights /= _scale(weights)
        weights += 1.0
        weights *= weights
        rotation = _turned(rotation, (target / weights[..., None, :]) @ carried.swapaxes(-1, -2))
    ordered = np.sort(_squared(target - rotation @ source), axis=-1)
    kept = max(MIN_POINTS, int(TRUSTED_SHARE * count))
    return RotationFits(
        rotation,
        headings(rotation),
        np.sqrt(ordered[..., :kept].sum(axis=-1) / kept),
    )


def headings(rotation: FloatArray) -> FloatArray:
    """Return the heading errors [rad, left positive] of rotations, (..., 3, 3): (...)."""
    sine = rotation[..., 2, 0] - rotation[..., 0, 2]
    return np.asarray(np.arctan2(sine, rotation[..., 0, 0] + rotation[..., 2, 2]))


def _squared(offset: FloatArray) -> FloatArray:
    """Return the squared lengths of columns, shape (..., 3, N): (..., N)."""
    return np.asarray(np.add.reduce(offset * offset, axis=-2))


def _scale(squared: FloatArray) -> FloatArray | float:
    """Return what squared distances, (..., N), are taken in units of: a number of one view."""
    median = medians(squared)
    if not median.ndim:
        return max(4.0 * float(median), SMALLEST)
    return np.asarray(np.maximum(4.0 * median, SMALLEST)[..., None])


def _kabsch(product: FloatArray) -> FloatArray:
    """Return R that maximises tr(R^T ``product``), the sum of w target source^T, (..., 3, 3)."""
    u, _, vt = np.linalg.svd(product)
    nearest = np.asarray(u @ vt)
    mirrored = [_determinant(each) < 0.0 for each in nearest.reshape(-1, 9).tolist()]
    if not any(mirrored):
        return nearest
    u[..., 2] *= np.where(np.reshape(mirrored, product.shape[:-2]), -1.0, 1.0)[..., None]
    return np.asarray(u @ vt)


def _determinant(entries: Entries) -> float:
    """Return the determinant of a matrix for its entries, row by row: numbers, for speed."""
    xx, xy, xz, yx, yy, yz, zx, zy, zz = entries
    return xx * (yy * zz - yz * zy) - xy * (yx * zz - yz * zx) + xz * (yx * zy - yy * zx)


def _turned(rotation: FloatArray, product: FloatArray) -> FloatArray:
    """
    Return ``rotation`` after one step of Newton towards that of ``_kabsch``, (..., 3, 3).

    ``product`` is the sum of w target (R source)^T, symmetric at the best R. A step leaves an
    error of the square of its length or less: new weights turn R by little, then less and less.
    """
    steps = [_step(each) for each in product.reshape(-1, 9).tolist()]
    return np.asarray(np.array(steps).reshape(product.shape) @ rotation)


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
