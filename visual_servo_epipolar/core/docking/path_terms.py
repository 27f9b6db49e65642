"""What the bundle knows beside images: the driven path, a level floor, what was told."""

import numpy as np

from visual_servo_epipolar.core.arrays import FloatArray
from visual_servo_epipolar.core.docking.planar import between, composed, inverse
from visual_servo_epipolar.core.docking.unknowns import (
    MOUNT,
    Problem,
    SCALE,
    SHARED,
    Unknowns,
    VIEW,
    YAW,
)

DIFFERENCE = 1e-6  # of numerical derivatives


def path_residuals(problem: Problem, unknowns: Unknowns) -> FloatArray:
    """Return by how much the base's motions differ from the path, (K - 1, 3), in deviations."""
    views = unknowns.views
    apart = _motions(views[:-1], views[1:], unknowns.shared) - problem.path
    apart[:, 2] = np.remainder(apart[:, 2] + np.pi, 2.0 * np.pi) - np.pi
    return np.asarray((problem.weights @ apart[..., None])[..., 0])


def residuals(problem: Problem, unknowns: Unknowns) -> FloatArray:
    """Return the residuals of path, floor and what was told, in deviations."""
    floor = unknowns.views[:, 3:] / problem.jitter
    told = (unknowns.shared - problem.prior) / problem.deviations
    return np.concatenate([path_residuals(problem, unknowns).ravel(), floor.ravel(), told])


def slopes(problem: Problem, unknowns: Unknowns) -> FloatArray:
    """Return their derivatives by views and shared unknowns, shape (..., 5 K + 6)."""
    count = len(unknowns.views)
    rows, size = 3 * (count - 1), VIEW * count
    whole = np.zeros((rows + 2 * count + SHARED, size + SHARED))
    _fill_path(whole[:rows], problem, unknowns)
    for k in range(count):
        floor = rows + 2 * k
        whole[floor : floor + 2, VIEW * k + 3 : VIEW * k + 5] = np.eye(2) / problem.jitter
    np.fill_diagonal(whole[rows + 2 * count :, size:], 1.0 / problem.deviations)
    return whole


def _fill_path(rows: FloatArray, problem: Problem, unknowns: Unknowns) -> None:
    """Fill in the derivatives of the path, which are numerical."""
    views, shared = unknowns.views, unknowns.shared
    first, second, count = views[:-1], views[1:], len(views)
    before = _motions(first, second, shared)

    def slope(motions: FloatArray) -> FloatArray:
        return np.asarray((problem.weights @ ((motions - before) / DIFFERENCE)[..., None])[..., 0])

    for j in range(3):
        shift = DIFFERENCE * np.eye(VIEW)[j]
        begun = slope(_motions(first + shift, second, shared))
        ended = slope(_motions(first, second + shift, shared))
        for k in range(count - 1):
            rows[3 * k : 3 * k + 3, VIEW * k + j] = begun[k]
            rows[3 * k : 3 * k + 3, VIEW * (k + 1) + j] = ended[k]
    for j in range(YAW, SHARED):
        other = shared + DIFFERENCE * np.eye(SHARED)[j]
        rows[:, VIEW * count + j] = slope(_motions(first, second, other)).ravel()


def _motions(first: FloatArray, second: FloatArray, shared: FloatArray) -> FloatArray:
    """Return the motions of the base from views to others, (K, 3), as odometry would have them."""
    mount = np.broadcast_to(inverse(shared[MOUNT]), (len(first), 3))
    motions = between(composed(first[:, :3], mount), composed(second[:, :3], mount))
    motions[:, :2] *= np.exp(-shared[SCALE])
    return motions
