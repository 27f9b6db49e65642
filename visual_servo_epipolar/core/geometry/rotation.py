"""Rotation between two views without a baseline, and the parallax that it leaves unexplained."""

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from visual_servo_epipolar.core.arrays import FloatArray, median_of_sorted
from visual_servo_epipolar.core.errors import DegenerateGeometryError

ITERATIONS = 6
MIN_POINTS = 3
TRUSTED_SHARE = 0.6  # of the matches that make the parallax: the worst may be outliers
SMALLEST = 1e-18  # squared distance by which weights are scaled at least [rad^2]
RIDGE = 1e-12  # keeps the equations of a turn regular where all matches coincide
IDENTITY = np.eye(3)
# What turns a vector w into the matrix of w x, row by row.
CROSS = np.zeros((3, 9))
CROSS[0, [5, 7]] = CROSS[1, [6, 2]] = CROSS[2, [1, 3]] = -1.0, 1.0


@dataclass(frozen=True, slots=True)
class RotationFit:
    """
    Best rotation R current -> desired, its heading error [rad] and the parallax it leaves.

    ``parallax`` is a robust root mean square angle [rad].
    """

    rotation: FloatArray
    heading_error: float
    parallax: float


class RotationFits(NamedTuple):
    """Best rotations of views, shape (..., 3, 3), heading errors and parallaxes, (...) [rad]."""

    rotation: FloatArray
    heading_error: FloatArray
    parallax: FloatArray

    def each(self) -> 'list[RotationFit]':
        """Return those of single views, of a stack of them."""
        turns = zip(self.heading_error.tolist(), self.parallax.tolist(), strict=True)
        return [RotationFit(self.rotation[k], *turn) for k, turn in enumerate(turns)]


def fit_rotation(current: FloatArray, desired: FloatArray) -> RotationFit:
    """
    Fit the infinite homography: the rotation alone that best carries one view into the other.

    See ``fit_rotations``; unit rays have shape (N, 3).

    Raises
    ------
    DegenerateGeometryError
        With fewer than three matches.

    """
    rotation, heading_error, parallax = fit_rotations(current, desired)
    return RotationFit(rotation, float(heading_error), float(parallax))


def fit_rotations(current: FloatArray, desired: FloatArray) -> RotationFits:
    """
    Fit the rotation of each pair of views, unit rays of shape (..., N, 3).

    Weighted Kabsch alignment of the rays, reweighted (Geman-McClure) so that outliers and the few
    near features with large parallax do not turn it. The remark closing section IV-B of the paper.

    Raises
    ------
    DegenerateGeometryError
        With fewer than three matches.

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
        scale = np.maximum(4.0 * median_of_sorted(np.sort(weights, axis=-1)), SMALLEST)
        weights = (1.0 + weights / scale[..., None]) ** 2
        rotation = _turned(rotation, (target / weights[..., None, :]) @ carried.swapaxes(-1, -2))
    ordered = np.sort(_squared(target - rotation @ source), axis=-1)
    kept = max(MIN_POINTS, int(TRUSTED_SHARE * count))
    return RotationFits(
        rotation,
        np.arctan2(
            rotation[..., 2, 0] - rotation[..., 0, 2], rotation[..., 0, 0] + rotation[..., 2, 2]
        ),
        np.sqrt(ordered[..., :kept].sum(axis=-1) / kept),
    )


def _squared(offset: FloatArray) -> FloatArray:
    """Return the squared lengths of columns, shape (..., 3, N): (..., N)."""
    return np.asarray((offset * offset).sum(axis=-2))


def _kabsch(product: FloatArray) -> FloatArray:
    """Return R that maximises tr(R^T ``product``), the sum of w target source^T, (..., 3, 3)."""
    u, _, vt = np.linalg.svd(product)
    u[..., 2] *= np.sign(np.linalg.det(u @ vt))[..., None]
    return np.asarray(u @ vt)


def _turned(rotation: FloatArray, product: FloatArray) -> FloatArray:
    """
    Return ``rotation`` after one step of Newton towards that of ``_kabsch``, (..., 3, 3).

    ``product`` is the sum of w target (R source)^T, symmetric at the best R. A step leaves an
    error of the square of its length or less: new weights turn R by little, then less and less.
    """
    transposed = product.swapaxes(-1, -2)
    # The sum of w (R source) x target.
    pull = (product - transposed)[..., [2, 0, 1], [1, 2, 0]]
    trace = product.trace(axis1=-2, axis2=-1)[..., None, None]
    stiffness = (1.0 + RIDGE) * trace * IDENTITY - 0.5 * (product + transposed)
    half = 0.5 * np.linalg.solve(stiffness, pull[..., None])
    cross = (half.swapaxes(-1, -2) @ CROSS).reshape(*half.shape[:-2], 3, 3)
    # Cayley's map is a rotation whatever the length of the step.
    return np.asarray(np.linalg.solve(IDENTITY - cross, (IDENTITY + cross) @ rotation))
