"""
Gauss-Newton on the Sampson distance: from one start, or from many of which the best modes go on.

A model turns parameters, shape (..., P), into E and its derivatives by them, (..., 1 + P, 9).
"""

from collections.abc import Callable
import math
from typing import Any, NamedTuple

import numpy as np

from visual_servo_epipolar.core.arrays import BoolArray, FloatArray, IntArray
from visual_servo_epipolar.core.errors import DegenerateGeometryError
from visual_servo_epipolar.core.estimators.machinery.hypotheses import (
    ALTERNATIVE_COST,
    best_modes,
    INLIER_DEVIATIONS,
    MARGIN,
    Rays,
    SEPARATION,
)
from visual_servo_epipolar.core.estimators.machinery.sampson import linearised, table_of
from visual_servo_epipolar.core.geometry.rays import Axes, tangents

TUKEY = 4.685  # 95 % efficient for Gaussian noise
LARGEST_STEP = 0.2  # a longer one leaves where the linearisation means anything [rad]
NEGLIGIBLE = 0.3  # step that ends the iterations, in deviations of the noise: the next is tiny
ANNEALING = 3  # steps until a wide start has narrowed to the noise
SHORT_ANNEALING = 2  # the number where the start is near the truth
ITERATIONS = 9
ROUGH, MODES = 3, 3  # steps with all modes, and how many may go on
LEVERAGE, LEAST_SPARE = 0.5, 1e-4  # of a match that nothing speaks for; what others leave it
RIDGE = 1e-3  # information that keeps normal matrices regular: a deviation of 30 rad

Model = Callable[[FloatArray], FloatArray]


class GaussianPrior(NamedTuple):
    """Gaussian prior of P parameters: mean, shape (P,), and information, (P, P)."""

    mean: FloatArray
    information: FloatArray


class Problem(NamedTuple):
    """What is minimised: ``model`` on the ``table`` of matches, and the ``prior``."""

    model: Model
    table: FloatArray  # shape (9, 5 N)
    prior: GaussianPrior
    ridge: FloatArray  # shape (P, P): the information of the prior, never zero
    negligible: float  # step that ends the iterations [rad]


def problem_of(
    model: Model,
    prior: GaussianPrior,
    rays: Rays,
    plausible: BoolArray | None = None,
    axes: Callable[..., Axes] = tangents,
) -> Problem:
    """Return what is minimised; see ``table_of`` for how ``rays`` enter."""
    ridge = prior.information + RIDGE * np.eye(len(prior.mean))
    negligible = float(NEGLIGIBLE * rays.mean_noise)
    return Problem(model, table_of(rays, plausible, axes), prior, ridge, negligible)


class Fit(NamedTuple):
    """
    Refined parameters, (..., P), their information, (..., P, P), and their costs, (...).

    ``squared`` distances, (..., N), and costs are in deviations of the noise; a cost is the sum of
    the truncated ones, and the price of leaving the prior. ``slopes``, (..., P, N), are the
    derivatives of distances, each by the root of its match's weight.
    """

    parameters: FloatArray
    information: FloatArray
    costs: FloatArray
    squared: FloatArray
    slopes: FloatArray

    def take(self, rows: Any) -> 'Fit':
        """Return the fits chosen by index or mask."""
        return Fit(*(part[rows] for part in self))

    def covariance(self) -> FloatArray:
        """
        Return the covariance of the parameters of one fit, shape (P, P).

        Where one match has more than half a parameter to itself, nothing speaks for it: what it
        alone fixes, such as an epipole on top of it, counts as not known (Huber 1981, 7.2).
        """
        covariance = np.asarray(np.linalg.inv(self.information))
        moves = covariance @ self.slopes
        leverage = (moves * self.slopes).sum(axis=0)
        lonely = leverage > LEVERAGE
        if not lonely.any():
            return covariance
        moves /= np.sqrt(np.where(lonely, np.maximum(1.0 - leverage, LEAST_SPARE), np.inf))
        move = moves[:, (moves[:2] * moves[:2]).sum(axis=0).argmax()]
        return np.asarray(covariance + np.outer(move, move))

    def of_all(self, plausible: BoolArray) -> 'Fit':
        """Return one fit with infinite distances of the matches that it was made without."""
        squared = np.full(plausible.shape, np.inf)
        squared[plausible] = self.squared
        return self._replace(squared=squared)


def refined(start: FloatArray, problem: Problem, scale: float = 1.0) -> Fit:
    """
    Minimise the robust Sampson distance by Gauss-Newton from one ``start``, shape (P,).

    The start is near the truth. The first steps take the noise for ``scale`` times larger: they
    must not lose matches that the other parameters will bring back. It ends once a step is
    negligible. Singular equations give nan.
    """
    for iteration in range(1, ITERATIONS + 1):
        width = annealed(scale, iteration, SHORT_ANNEALING)
        step = gauss_newton_step(problem, start, width)
        if iteration == ITERATIONS or not (width > 1.0 or step.length >= problem.negligible):
            break
        start = step.parameters
    return step.fit(problem, width)


def refined_modes(starts: FloatArray, problem: Problem, scale: float = 1.0) -> Fit:
    """
    Minimise from many ``starts``, shape (K, P); after a few steps only the best modes go on.

    The first steps take the noise for ``scale`` times larger. It ends once all steps are
    negligible.

    Raises
    ------
    DegenerateGeometryError
        If the normal equations are singular.

    """
    rough = ROUGH if scale > 1.0 else 1
    for iteration in range(1, ITERATIONS + 1):
        width = annealed(scale, iteration, ANNEALING)
        step = gauss_newton_step(problem, starts, width)
        longest = float(np.maximum.reduce(step.length))
        if math.isnan(longest):
            raise DegenerateGeometryError(
                'the normal equations of the matches are singular; pass rays of unit length and '
                'their noise as an angle [rad]'
            )
        if iteration == ITERATIONS or (width == 1.0 and longest < problem.negligible):
            break
        starts = step.parameters
        if len(starts) > 1 and iteration >= rough:
            starts = starts[_best_modes(step.fit(problem, width))]
    return step.fit(problem, width)


def _best_modes(fit: Fit) -> IntArray:
    """Return the places of the best different modes among those that may still win."""
    worst = INLIER_DEVIATIONS**2 * fit.squared.shape[1]
    return best_modes(
        np.exp(1j * fit.parameters[:, :2].T),
        fit.costs / worst,
        MODES,
        separation=0.25 * SEPARATION,
        margin=min(MARGIN, 2.0 * ALTERNATIVE_COST / worst),
    )


class Step(NamedTuple):
    """
    One step of Gauss-Newton: new parameters, (..., P), and what it found before.

    Information, (..., P, P), ``squared`` distances, (..., N), and ``slopes``, (..., P, N), are as
    a Fit has them; ``deviation`` is that from the mean of the prior, (..., P), ``length`` the
    largest change of a parameter, (...).
    """

    parameters: FloatArray
    information: FloatArray
    squared: FloatArray
    slopes: FloatArray
    deviation: FloatArray
    length: FloatArray

    def fit(self, problem: Problem, width: FloatArray | float) -> Fit:
        """Return the fits after the step, with the costs before it."""
        costs = np.minimum(self.squared / (width * width), INLIER_DEVIATIONS**2).sum(axis=-1)
        costs += (self.deviation * _pull(problem.prior, self.deviation)).sum(axis=-1)
        return Fit(self.parameters, self.information, costs, self.squared, self.slopes)


def gauss_newton_step(problem: Problem, parameters: FloatArray, width: FloatArray | float) -> Step:
    """Return the step from ``parameters``, (..., P), with the noise ``width`` times larger."""
    prior = problem.prior
    rows, squared_gradient = linearised(problem.model(parameters), problem.table)
    squared = rows[..., 0, :] * rows[..., 0, :] / squared_gradient
    weight = np.maximum(1.0 - squared / (TUKEY * TUKEY * width * width), 0.0)
    # Tukey's weight is the square of this
    rows *= (weight / np.sqrt(squared_gradient))[..., None, :]
    normal = rows @ rows.swapaxes(-2, -1)
    deviation = parameters - prior.mean
    information = normal[..., 1:, 1:] + problem.ridge
    change = _solved(information, normal[..., 1:, 0] + _pull(prior, deviation))
    length = np.maximum.reduce(np.abs(change), axis=-1)
    if (length > LARGEST_STEP).any():
        change = np.clip(change, -LARGEST_STEP, LARGEST_STEP)
    return Step(parameters - change, information, squared, rows[..., 1:, :], deviation, length)


def _pull(prior: GaussianPrior, deviation: FloatArray) -> FloatArray:
    """Return the information of the prior times the ``deviation`` from its mean, (..., P)."""
    # Never a product of matrices: its bits would depend on how many geometries are side by side.
    return np.asarray((prior.information * deviation[..., None, :]).sum(axis=-1))


def annealed(scale: Any, iteration: int, steps: int) -> Any:
    """Return how much wider than the noise iteration 1, 2, ... takes it; 1 after ``steps``."""
    return 1.0 + (scale - 1.0) * max(0.0, 1.0 - (iteration - 1) / steps)


def _solved(information: FloatArray, pull: FloatArray) -> FloatArray:
    """Return the solutions of normal equations, shape (..., P), nan where they are singular."""
    try:
        if pull.ndim == 1:
            return np.asarray(np.linalg.solve(information, pull))
        return np.asarray(np.linalg.solve(information, pull[..., None])[..., 0])
    except np.linalg.LinAlgError:
        if pull.ndim == 1:
            return np.full_like(pull, np.nan)
    return np.array([_solved(*each) for each in zip(information, pull, strict=True)])
