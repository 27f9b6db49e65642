"""
Bundle: photograph, views and driven path in one weighted least-squares problem, in metres.

A feature is a ray of the photograph, off by its noise, and an inverse depth; a view the place and
the heading of its camera beside that of the photograph, and what the floor tilts and rolls it by.
All views share the attitude of the camera, its mount on the base, and the scale of the odometry.
Images alone tell the shape of it, the driven path how large it is. Features are eliminated (Schur
complement): what is left is a covariance with the photograph's noise, common to all views, in it.
"""

from dataclasses import dataclass
import math

import numpy as np

from visual_servo_epipolar.core.arrays import FloatArray
from visual_servo_epipolar.core.docking import path_terms
from visual_servo_epipolar.core.docking.projection import projected, Projection, slopes
from visual_servo_epipolar.core.docking.unknowns import Problem, SHARED, Unknowns, VIEW

LEAST_INFORMATION = 1e-4  # of an inverse depth that nothing shows [m^2]
CAUTION = 5.0  # deviations at which a residual counts a quarter while it is iterated
OUTLIER = 4.0  # deviations from which a sighting does not count in the end
DAMPING = 1e-3
LEAST_GAIN = 0.02  # of the sum of squares, below which nothing changes that matters


@dataclass(frozen=True, eq=False)
class Solution:
    """
    The best ``unknowns``, and the covariance of views and shared ones, (5 K + 6, 5 K + 6).

    ``noise_ratio`` is the deviation of image residuals over that expected, ``path_ratio`` that of
    the path's; ``inliers`` the share of the sightings in the last view that count; ``cost`` the
    sum of squares.
    """

    unknowns: Unknowns
    cost: float
    covariance: FloatArray
    noise_ratio: float
    path_ratio: float
    inliers: float


@dataclass(frozen=True, eq=False)
class _System:
    """Normal equations of views and shared unknowns, and what features follow by."""

    matrix: FloatArray
    vector: FloatArray
    blocks: FloatArray  # of features, inverted, (N, 3, 3)
    coupling: FloatArray  # (N, 3, 5 K + 6)
    gradient: FloatArray  # of features, (N, 3)
    weight: FloatArray  # of sightings, (N, K)
    squares: FloatArray  # of image residuals, (N, K)


def cost(problem: Problem, unknowns: Unknowns) -> float:
    """Return the sum of squares in deviations, none of an image more than an outlier counts."""
    squares = (projected(problem, unknowns).residuals ** 2).sum(-1)
    image = (problem.seen * squares / (1.0 + squares / CAUTION**2)).sum()
    beside = path_terms.residuals(problem, unknowns)
    return float(image + (unknowns.offsets**2).sum() + beside @ beside)


def solved(problem: Problem, start: Unknowns, iterations: int) -> Solution:
    """Return the solution that is reached from ``start`` (Levenberg, Marquardt)."""
    unknowns, least, damping = start, cost(problem, start), DAMPING
    for _ in range(iterations):
        system = _system(problem, unknowns, cautious=True)
        candidate = _moved(unknowns, system, damping)
        reached = cost(problem, candidate)
        if not reached < least:
            damping *= 100.0
            continue
        gain = least - reached
        unknowns, least, damping = candidate, reached, 0.1 * damping
        if gain < LEAST_GAIN:
            break
    return _concluded(problem, unknowns, least)


def _system(problem: Problem, unknowns: Unknowns, *, cautious: bool) -> _System:
    projection = projected(problem, unknowns)
    squares = (projection.residuals**2).sum(-1)
    doubt = (1.0 + squares / CAUTION**2) ** -2 if cautious else 1.0 * (squares < OUTLIER**2)
    weight = problem.seen * doubt
    whole, features = _jacobians(problem, unknowns, projection, np.sqrt(weight))
    count = len(features)
    residuals = (np.sqrt(weight)[..., None] * projection.residuals).reshape(count, -1)
    turned = features.swapaxes(1, 2)
    blocks = turned @ features
    blocks[:, [0, 1], [0, 1]] += 1.0  # an offset is one deviation
    blocks[:, 2, 2] += LEAST_INFORMATION
    blocks = np.asarray(np.linalg.inv(blocks), np.float64)
    coupling = turned @ whole
    gradient = (turned @ residuals[..., None])[..., 0]
    gradient[:, :2] += unknowns.offsets
    flat, eliminated = whole.reshape(-1, whole.shape[-1]), (blocks @ coupling)
    eliminated, coupled = (part.reshape(3 * count, -1) for part in (eliminated, coupling))
    beside, slope = path_terms.residuals(problem, unknowns), path_terms.slopes(problem, unknowns)
    return _System(
        flat.T @ flat - eliminated.T @ coupled + slope.T @ slope,
        flat.T @ residuals.ravel() - eliminated.T @ gradient.ravel() + slope.T @ beside,
        blocks,
        coupling,
        gradient,
        weight,
        squares,
    )


def _jacobians(
    problem: Problem, unknowns: Unknowns, projection: Projection, root: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Return weighted derivatives, (N, 2 K, 5 K + 6) and by features, (N, 2 K, 3)."""
    by_view, by_attitude, by_feature = slopes(problem, unknowns, projection)
    count, views = problem.seen.shape
    size = VIEW * views
    whole = np.zeros((count, views, 2, size + SHARED))
    for k in range(views):
        whole[:, k, :, VIEW * k : VIEW * (k + 1)] = by_view[:, k]
    whole[..., size : size + 2] = by_attitude
    whole *= root[..., None, None]
    features = root[..., None, None] * by_feature
    return whole.reshape(count, 2 * views, -1), features.reshape(count, 2 * views, 3)


def _moved(unknowns: Unknowns, system: _System, damping: float) -> Unknowns:
    """Return the unknowns after a damped step, with the features that follow from it."""
    damped = system.matrix + damping * np.diag(np.diag(system.matrix))
    step = np.linalg.solve(damped, -system.vector)
    rest = system.gradient + system.coupling @ step
    features = -(system.blocks @ rest[..., None])[..., 0]
    return Unknowns(
        unknowns.views + step[:-SHARED].reshape(-1, VIEW),
        unknowns.shared + step[-SHARED:],
        unknowns.offsets + features[:, :2],
        unknowns.nearness + features[:, 2],
    )


def _concluded(problem: Problem, unknowns: Unknowns, least: float) -> Solution:
    """Return the solution at ``unknowns``, by the sightings that are no outliers alone."""
    system = _system(problem, unknowns, cautious=False)
    count = int(system.weight.sum())
    last = float(system.weight[:, -1].sum()) / max(int(problem.seen[:, -1].sum()), 1)
    squares = float((system.weight * system.squares).sum() + (unknowns.offsets**2).sum())
    # The path tells most of where the views are; their floor, and a scale, images alone.
    freedom = 2 * count - len(unknowns.nearness) - 2 * len(unknowns.views) - 2
    path = path_terms.path_residuals(problem, unknowns)
    covariance = np.linalg.inv(system.matrix)
    return Solution(
        unknowns,
        least,
        0.5 * (covariance + covariance.T),
        math.sqrt(squares / freedom) if freedom > 0 else math.inf,
        math.sqrt(float((path**2).mean())) if path.size else 1.0,
        last,
    )
