"""Epipolar geometry of two views that hardly differ but by a turn."""

import numpy as np

from visual_servo_epipolar.core.arrays import FloatArray, median_of_sorted
from visual_servo_epipolar.core.geometry.epipolar import cross_matrix

ROUNDS = 5
SMALLEST = 1e-18  # squared distance by which weights are scaled at least [rad^2]
RIDGE = 1e-6  # keeps the equations regular where all matches coincide
# Directions of the motion to start from: ahead, aside, and between.
STARTS = np.array([[0.0, 0.0, 1.0], [1.0, 0.0, 1.0], [1.0, 0.0, 0.0], [-1.0, 0.0, 1.0]])
NEXT, AFTER = np.array([1, 2, 0]), np.array([2, 0, 1])  # of three axes: np.cross is slow
STARTS /= np.linalg.norm(STARTS, axis=1)[:, None]


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
    carried = current @ rotation.T
    motion, turn = STARTS, np.zeros_like(STARTS)
    for _ in range(ROUNDS):
        distances, jacobian = _linearised(motion, turn, carried, desired)
        squared = distances * distances
        scale = np.maximum(4.0 * median_of_sorted(np.sort(squared, axis=1)), SMALLEST)[:, None]
        weighted = jacobian / ((1.0 + squared / scale) ** 2)[..., None]
        normal = weighted.swapaxes(1, 2) @ jacobian
        size = np.trace(normal, axis1=1, axis2=2)[:, None, None]
        right = weighted.swapaxes(1, 2) @ distances[..., None]
        normal += RIDGE * size * np.eye(6)
        normal[:, :3, :3] += size * motion[:, :, None] * motion[:, None, :]  # keeps its length
        change = -np.linalg.solve(normal, right)[..., 0]
        motion = motion + change[:, :3]
        motion = motion / np.sqrt((motion * motion).sum(axis=1))[:, None]
        turn = turn + change[:, 3:]
    distances, _ = _linearised(motion, turn, carried, desired)
    best = int(np.argmin(median_of_sorted(np.sort(np.abs(distances), axis=1))))
    turned = rotation + _cross(turn[best], rotation.T).T
    return np.asarray(cross_matrix(motion[best]) @ turned)


def _linearised(
    motion: FloatArray, turn: FloatArray, carried: FloatArray, desired: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """
    Return distances from the geometry [rad], (S, N), and their Jacobian, (S, N, 6).

    ``motion`` and ``turn``, (S, 3), are the direction and the rotation on top of ``carried``.
    """
    rays = carried + _cross(turn[:, None], carried)
    normal = _cross(motion[:, None], desired)  # across the epipolar lines
    length = np.sqrt(np.maximum((normal * normal).sum(axis=2), 1e-12))[..., None]
    lever = _cross(rays, desired) / length
    distances = (lever * motion[:, None]).sum(axis=2)
    by_turn = _cross(carried, _cross(desired, motion[:, None])) / length
    return distances, np.concatenate([lever, by_turn], axis=2)


def _cross(first: FloatArray, second: FloatArray) -> FloatArray:
    return np.asarray(
        first[..., NEXT] * second[..., AFTER] - first[..., AFTER] * second[..., NEXT]
    )
