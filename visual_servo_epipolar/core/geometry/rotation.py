"""Rotation between two views, the parallax that it leaves, and F of a baseline within noise."""

from dataclasses import dataclass
import math

import numpy as np

from visual_servo_epipolar.core.arrays import FloatArray, median, medians
from visual_servo_epipolar.core.errors import DegenerateGeometryError
from visual_servo_epipolar.core.geometry.least_squares import (
    cauchy,
    Equations,
    least_squares,
    REWEIGHTINGS,
    RIDGE,
)
from visual_servo_epipolar.core.geometry.rays import normalised

MIN_POINTS = 3
TRUSTED_SHARE = 0.6  # of the matches that make the parallax: the worst may be outliers
TINY = 1e-12  # angle, or squared length of a normal, that is divided by


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


ROUNDS = 5
# Directions of the motion to start from: ahead, aside, and between.
STARTS = np.array([[0.0, 0.0, 1.0], [1.0, 0.0, 1.0], [1.0, 0.0, 0.0], [-1.0, 0.0, 1.0]])
STARTS /= np.linalg.norm(STARTS, axis=1)[:, None]
# What turns a vector w into the matrix of w x, row by row.
CROSS = np.zeros((3, 9))
CROSS[0, [5, 7]] = CROSS[1, [6, 2]] = CROSS[2, [1, 3]] = -1.0, 1.0
LEVI_CIVITA = -CROSS.reshape(3, 3, 3)
IDENTITY = np.eye(3).ravel()
RIDGES = RIDGE * np.eye(6)
# What turns A into the matrix of (A c) x t, and m into that of (m x t) x c, by products c t.
LEVER = np.einsum('kij,lm->ilkmj', LEVI_CIVITA, np.eye(3)).reshape(9, 27)
PULL = np.einsum('kij,ipq->pkjq', LEVI_CIVITA, LEVI_CIVITA).reshape(3, 27)


def fundamental_of_small_baseline(
    rotation: FloatArray, current: FloatArray, desired: FloatArray
) -> FloatArray:
    """
    Return F for rays, shape (3, 3), of a baseline that may be as small as the noise.

    Gauss-Newton on the direction of the motion and on the rotation, reweighted (Geman-McClure),
    from several directions. Where the direction is lost in the noise, distances from F are those
    of the noise all the same: that is what F is for. The best ``rotation``, (3, 3), is that of
    ``fit_rotation``; unit rays, at least three, have shape (N, 3).
    """
    carried, target = rotation @ current.T, np.ascontiguousarray(desired.T)
    products = (carried[:, None] * target).reshape(9, -1)

    def linearise(unknowns: FloatArray, number: int) -> Equations:
        motion = unknowns[:, :3]
        rows = _linearised(unknowns, target, products)
        squared = rows[:, 0] * rows[:, 0]
        rows *= cauchy(squared, 4.0 * medians(squared)[:, None])[:, None]
        information, pull = Equations.of(rows)
        size = np.trace(information, axis1=-2, axis2=-1)[:, None, None]
        information = information + size * RIDGES
        # Keeps the length of the motion.
        information[:, :3, :3] += size * motion[:, :, None] * motion[:, None, :]
        return Equations(information, pull)

    def moved(unknowns: FloatArray, at: Equations, change: FloatArray) -> tuple[FloatArray, bool]:
        after = unknowns - change
        after[:, :3] = normalised(after[:, :3])
        return after, False

    start = np.hstack([STARTS, np.zeros(STARTS.shape)])
    unknowns, _ = least_squares(start, linearise, moved, ROUNDS)
    distances = _linearised(unknowns, target, products)[:, 0]
    best = unknowns[medians(np.abs(distances)).argmin()]
    turned = rotation + _crossed(best[3:]) @ rotation
    return np.asarray(_crossed(best[:3]) @ turned)


def _crossed(vectors: FloatArray) -> FloatArray:
    """Return [v]x of vectors, (..., 3): (..., 3, 3)."""
    return np.asarray((vectors @ CROSS).reshape(*vectors.shape, 3))


def _linearised(unknowns: FloatArray, target: FloatArray, products: FloatArray) -> FloatArray:
    """
    Return distances from the geometry [rad] and their derivatives, (S, 7, N).

    ``unknowns``, (S, 6), are the direction of the motion and the turn on top of the carried rays,
    ``products`` theirs with the ``target``, (9, N). Both are linear in these: one matrix gives all
    columns.
    """
    motion, turn = unknowns[:, :3], unknowns[:, 3:]
    across = _crossed(motion) @ target  # epipolar lines
    across *= across
    length = np.sqrt(np.maximum(np.add.reduce(across, axis=-2), TINY))[:, None]
    rows = np.empty((len(unknowns), 7, target.shape[1]))
    columns = np.hstack([(IDENTITY + turn @ CROSS) @ LEVER, motion @ PULL])
    np.divide(columns.reshape(-1, 6, 9) @ products, length, out=rows[:, 1:])
    np.add.reduce(rows[:, 1:4] * motion[..., None], axis=-2, out=rows[:, 0])
    return rows
