"""
Least squares: normal equations of weighted residuals, linear fits, samples for robust searches.

Callers state residuals and Jacobian, and weigh residuals as their noise and outliers ask for.
"""

from collections.abc import Callable
from typing import NamedTuple

import numpy as np

from visual_servo_epipolar.core.arrays import FloatArray, IntArray, NORMAL

LARGEST_CONDITION = 1.0 / float(np.finfo(np.float64).eps)  # of equations that say something


class LinearFit(NamedTuple):
    """Fit of P columns to N values: ``solution``, (P, ...), what it leaves, (N, ...), (P, P)."""

    solution: FloatArray
    residual: FloatArray
    normal: FloatArray

    def covariance(self) -> FloatArray:
        """Return the covariance of the solution, (P, P), at a deviation of 1 of each value."""
        return np.asarray(np.linalg.inv(self.normal))


def linear_fit(
    columns: FloatArray, values: FloatArray, weight: FloatArray | None = None, ridge: float = 0.0
) -> LinearFit:
    """Return the fit of ``columns``, (N, P), to ``values``, (N, ...), by ``weight``, (N,)."""
    weighted, goal = columns, values
    if weight is not None:
        weighted = weight[:, None] * columns
        goal = weight.reshape(-1, *[1] * (values.ndim - 1)) * values
    normal = columns.T @ weighted
    normal += ridge * np.eye(len(normal))
    solution = np.asarray(np.linalg.solve(normal, columns.T @ goal), np.float64)
    return LinearFit(solution, values - columns @ solution, normal)


def robust_fit(
    columns: FloatArray,
    values: FloatArray,
    weigh: Callable[[FloatArray], FloatArray],
    rounds: int,
) -> LinearFit | None:
    """Return the fit reweighted by what it leaves, (N,); None where columns look alike."""
    weight, fit = np.ones(len(values)), None
    for _ in range(rounds):
        if np.linalg.cond(columns.T @ (weight[:, None] * columns)) > LARGEST_CONDITION:
            return None
        fit = linear_fit(columns, values, weight)
        weight = weigh(fit.residual)
    return fit


def gauss_newton(
    jacobian: FloatArray, residual: FloatArray, weight: FloatArray, ridge: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """
    Return the change of parameters that lessens residuals, (..., P), and its information.

    ``jacobian`` has shape (..., P, N), ``residual`` and ``weight`` (..., N); ``ridge``, (P, P), is
    the information of a prior that draws to no change.
    """
    weighted = jacobian * weight[..., None, :]
    information = weighted @ jacobian.swapaxes(-1, -2) + ridge
    pull = weighted @ residual[..., None]
    return np.negative(np.linalg.solve(information, pull)[..., 0]), information


def deviation_of(median: float, spare: int) -> float:
    """Return the deviation of noise of which so many ``spare`` residuals have the ``median``."""
    return NORMAL * (1.0 + 5.0 / max(spare, 1)) * median  # Rousseeuw and Leroy 1987


def samples(rng: np.random.Generator, limit: int, count: int, size: int) -> IntArray:
    """Return ``limit`` samples of ``size`` different ones of ``count``, shape (limit, size)."""
    return np.asarray(rng.random((limit, count)).argsort(axis=1)[:, :size])
