"""Epipolar geometry of two views that hardly differ but by a turn."""

from typing import NamedTuple

import numpy as np

from visual_servo_epipolar.core.arrays import FloatArray, median_of_sorted
from visual_servo_epipolar.core.geometry.epipolar import cross_matrix

ROUNDS = 5
SMALLEST = 1e-18  # squared distance by which weights are scaled at least [rad^2]
RIDGE = 1e-6  # keeps the equations regular where all matches coincide
# Directions of the motion to start from: ahead, aside, and between.
STARTS = np.array([[0.0, 0.0, 1.0], [1.0, 0.0, 1.0], [1.0, 0.0, 0.0], [-1.0, 0.0, 1.0]])
STARTS /= np.linalg.norm(STARTS, axis=1)[:, None]
SHORTEST = 1e-12  # squared length of the normal of an epipolar plane
# What turns a vector w into the matrix of w x, row by row.
CROSS = np.zeros((3, 9))
CROSS[0, [5, 7]] = CROSS[1, [6, 2]] = CROSS[2, [1, 3]] = -1.0, 1.0
LEVI_CIVITA = -CROSS.reshape(3, 3, 3)
IDENTITY = np.eye(3).ravel()
DIAGONAL, RIDGES = np.arange(6), RIDGE * np.eye(6)
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
    of the noise all the same: that is what F is for.

    Parameters
    ----------
    rotation : array, shape (3, 3)
        Best rotation, current -> desired, as ``fit_rotation`` has it.
    current, desired : array, shape (N, 3)
        Unit rays, at least three.

    """
    carried, target = rotation @ current.T, np.ascontiguousarray(desired.T)
    pairs = _Pairs(target, (carried[:, None] * target).reshape(9, -1))
    motion, turn = STARTS, np.zeros_like(STARTS)
    for _ in range(ROUNDS):
        distances, jacobian = _linearised(motion, turn, pairs)
        squared = distances * distances
        scale = np.maximum(4.0 * median_of_sorted(np.sort(squared, axis=1)), SMALLEST)[:, None]
        weighted = jacobian / ((1.0 + squared / scale) ** 2)[:, None]
        normal = weighted @ jacobian.swapaxes(1, 2)
        size = normal[:, DIAGONAL, DIAGONAL].sum(axis=1)[:, None, None]
        right = weighted @ distances[..., None]
        normal += size * RIDGES
        normal[:, :3, :3] += size * motion[:, :, None] * motion[:, None, :]  # keeps its length
        change = -np.linalg.solve(normal, right)[..., 0]
        motion = motion + change[:, :3]
        motion = motion / np.sqrt((motion * motion).sum(axis=1))[:, None]
        turn = turn + change[:, 3:]
    distances, _ = _linearised(motion, turn, pairs)
    best = int(np.argmin(median_of_sorted(np.sort(np.abs(distances), axis=1))))
    turned = rotation + cross_matrix(turn[best]) @ rotation
    return np.asarray(cross_matrix(motion[best]) @ turned)


class _Pairs(NamedTuple):
    """Matches: rays that are turned, and the ``target``, (3, N); their ``products``, (9, N)."""

    target: FloatArray
    products: FloatArray


def _linearised(
    motion: FloatArray, turn: FloatArray, pairs: _Pairs
) -> tuple[FloatArray, FloatArray]:
    """
    Return distances from the geometry [rad], (S, N), and their Jacobian, (S, 6, N).

    ``motion`` and ``turn``, (S, 3), are the direction and the rotation on top of the carried rays.
    Both are linear in the products of coordinates: one matrix gives all columns.
    """
    normal = (motion @ CROSS).reshape(-1, 3, 3) @ pairs.target  # across the epipolar lines
    length = np.sqrt(np.maximum((normal * normal).sum(axis=1), SHORTEST))[:, None]
    by_motion = (IDENTITY + turn @ CROSS) @ LEVER
    rows = np.concatenate([by_motion, motion @ PULL], axis=1).reshape(-1, 6, 9)
    jacobian = (rows @ pairs.products) / length
    return (jacobian[:, :3] * motion[..., None]).sum(axis=1), jacobian
