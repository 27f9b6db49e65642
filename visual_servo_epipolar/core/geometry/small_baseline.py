"""Epipolar geometry of two views that hardly differ but by a turn."""

import numpy as np

from visual_servo_epipolar.core.arrays import FloatArray, medians

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
    turn, motion = np.zeros(STARTS.shape), STARTS
    for _ in range(ROUNDS):
        distances, jacobian = _linearised(motion, turn, target, products)
        squared = distances * distances
        scale = np.maximum(4.0 * medians(squared), SMALLEST)[..., None]
        weights = np.square(squared / scale + 1.0)
        weighted = jacobian / weights[:, None]
        normal = weighted @ jacobian.swapaxes(-1, -2)
        size = np.add.reduce(normal.reshape(-1, 36)[:, ::7], axis=1)[:, None, None]
        right = weighted @ distances[..., None]
        normal += size * RIDGES
        # Keeps the length of the motion.
        normal[:, :3, :3] += size * motion[:, :, None] * motion[:, None, :]
        change = np.linalg.solve(normal, right)[..., 0]
        motion = motion - change[:, :3]
        motion /= np.sqrt(np.add.reduce(motion * motion, axis=-1))[:, None]
        turn = turn - change[:, 3:]
    distances, _ = _linearised(motion, turn, target, products)
    best = medians(np.abs(distances)).argmin()
    turned = rotation + _crossed(turn[best]) @ rotation
    return np.asarray(_crossed(motion[best]) @ turned)


def _crossed(vectors: FloatArray) -> FloatArray:
    """Return [v]x of vectors, (..., 3): (..., 3, 3)."""
    return np.asarray((vectors @ CROSS).reshape(*vectors.shape, 3))


def _linearised(
    motion: FloatArray, turn: FloatArray, target: FloatArray, products: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """
    Return distances from the geometry [rad], (S, N), and their Jacobian, (S, 6, N).

    ``motion`` and ``turn``, (S, 3), are the direction and the rotation on top of the carried rays,
    ``products`` theirs with the ``target``, (9, N). Both are linear in these: one matrix gives all
    columns.
    """
    across = _crossed(motion) @ target  # epipolar lines
    across *= across
    length = np.sqrt(np.maximum(np.add.reduce(across, axis=-2), SHORTEST))[:, None]
    rows = np.hstack([(IDENTITY + turn @ CROSS) @ LEVER, motion @ PULL])
    jacobian = rows.reshape(-1, 6, 9) @ products
    jacobian /= length
    return np.add.reduce(jacobian[:, :3] * motion[..., None], axis=-2), jacobian
