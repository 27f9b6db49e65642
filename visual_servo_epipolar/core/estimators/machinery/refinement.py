"""
Gauss-Newton on the Sampson distance: many starts in one geometry, or many geometries side by side.

A model turns parameters, shape (K, P), into E and its derivatives by them, (K, 1 + P, 9).
"""

from collections.abc import Callable
import math
from typing import NamedTuple

import numpy as np

from visual_servo_epipolar.core.arrays import BoolArray, FloatArray, IntArray
from visual_servo_epipolar.core.errors import DegenerateGeometryError
from visual_servo_epipolar.core.estimators.machinery.hypotheses import (
    INLIER_DEVIATIONS,
    MARGIN,
    modes,
    RIVAL_COST,
    SPREAD,
)
from visual_servo_epipolar.core.estimators.machinery.sampson import linearised

TUKEY = 4.685  # 95 % efficient for Gaussian noise
LARGEST_STEP = 0.2  # a longer one leaves where the linearisation means anything [rad]
NEGLIGIBLE = 0.3  # step that ends the iterations, in deviations of the noise: the next is tiny
ANNEALING = 3  # steps until a wide start has narrowed to the noise
SHORT_ANNEALING = 2  # the same where the start is near the truth
ITERATIONS = 9
ROUGH, MODES = 3, 3  # steps with all modes, and how many may go on
RIDGE = 1e-3  # information that keeps normal matrices regular: a deviation of 30 rad
GOOD_COST = 1.8  # of a match, in squared deviations: noise, and outliers fewer than one in six

Model = Callable[[FloatArray], FloatArray]


class Belief(NamedTuple):
    """What is known of the parameters beforehand: mean and information, shape (..., P) each."""

    mean: FloatArray
    information: FloatArray


class Fit(NamedTuple):
    """
    Refined parameters, (K, P), their information, (K, P, P), and their costs, (K,).

    ``squared`` distances, (K, N), and costs are in deviations of the noise; a cost is the sum of
    the truncated ones, and the price of leaving the belief.
    """

    parameters: FloatArray
    information: FloatArray
    costs: FloatArray
    squared: FloatArray

    def take(self, rows: IntArray | BoolArray) -> 'Fit':
        """Return the fits chosen by index or mask."""
        return Fit(*(part[rows] for part in self))

    def covariance(self) -> FloatArray:
        """Return the covariance of the parameters, shape (K, P, P)."""
        return np.asarray(np.linalg.inv(self.information), dtype=np.float64)

    def winnowed(self) -> FloatArray:
        """Return the parameters of the best different modes among those that may still win."""
        worst = INLIER_DEVIATIONS**2 * self.squared.shape[1]
        margin = min(MARGIN, 2.0 * RIVAL_COST / worst)
        numbers = np.exp(1j * self.parameters[:, :2].T)
        best = modes(numbers, self.costs / worst, MODES, spread=0.25 * SPREAD, margin=margin)
        return np.asarray(self.parameters[best])


class Problem(NamedTuple):
    """What is minimised: ``model`` on the ``table`` of matches, and the ``belief``."""

    model: Model
    table: FloatArray  # shape (9, 5 N), or (B, 9, 5 N) for as many geometries
    belief: Belief
    ridge: FloatArray  # shape (P, P) or (B, P, P): the information of the belief, never zero

    def take(self, rows: BoolArray) -> 'Problem':
        """Return the geometries chosen by a mask."""
        belief = Belief(self.belief.mean[rows], self.belief.information[rows])
        return Problem(self.model, self.table[rows], belief, self.ridge[rows])


def problem(model: Model, table: FloatArray, belief: Belief) -> Problem:
    """Return what ``refined`` and ``followed`` minimise."""
    ridge = (belief.information + RIDGE)[..., None] * np.eye(belief.information.shape[-1])
    return Problem(model, table, belief, ridge)


def refined(start: FloatArray, problem: Problem, *, negligible: float, scale: float = 1.0) -> Fit:
    """
    Minimise the robust Sampson distance from each ``start``, shape (K, P), by Gauss-Newton.

    All are of one geometry. The first steps take the noise for ``scale`` times larger: they must
    not lose matches that the other parameters will bring back. Then only the best different modes
    go on, until a step is ``negligible``.

    Raises
    ------
    DegenerateGeometryError
        If the normal equations are singular.

    """
    parameters, first = start, ROUGH if scale > 1.0 else 1
    for iteration in range(1, ITERATIONS + 1):
        width = 1.0 + (scale - 1.0) * _left(iteration, ANNEALING)
        step = _step(problem, parameters, width)
        longest = float(np.maximum.reduce(step.length))
        if math.isnan(longest):
            raise DegenerateGeometryError(
                'the normal equations of the matches are singular; check the camera matrix, the '
                'rays are far from unit focal length'
            )
        done = iteration == ITERATIONS or (width == 1.0 and longest < negligible)
        if done:
            break
        many = len(parameters) > 1 and iteration >= first
        parameters = _fit(step, problem, width).winnowed() if many else step.parameters
    return _fit(step, problem, width)


def followed(
    start: FloatArray, problem: Problem, *, negligible: FloatArray, scale: FloatArray
) -> Fit:
    """
    Do the same for many geometries side by side, from one ``start`` each, shape (B, P).

    ``negligible`` and ``scale`` have shape (B,). Each goes its own way and ends when its own step
    is negligible: nothing depends on what is beside it. Singular equations give nan.
    """
    left, ended, wide = np.arange(len(start)), [], scale - 1.0
    for iteration in range(1, ITERATIONS + 1):
        width = (1.0 + wide * _left(iteration, SHORT_ANNEALING))[:, None]
        step = _step(problem, start, width)
        going = (width[:, 0] > 1.0) | (step.length >= negligible)
        count = np.count_nonzero(going)
        if iteration == ITERATIONS or not count:
            ended.append((left, _fit(step, problem, width)))
            break
        start = step.parameters
        if count < len(going):
            done = ~going
            fit = _fit(Step(*(part[done] for part in step)), problem.take(done), width[done])
            ended.append((left[done], fit))
            left, start, problem = left[going], start[going], problem.take(going)
            negligible, wide = negligible[going], wide[going]
    return _in_order(ended)


def _in_order(ended: list[tuple[IntArray, Fit]]) -> Fit:
    if len(ended) == 1:
        return ended[0][1]
    order = np.concatenate([places for places, _ in ended]).argsort()
    parts = zip(*(fit for _, fit in ended), strict=True)
    return Fit(*(np.concatenate(part)[order] for part in parts))


def goes_on(fit: Fit, before: FloatArray, deviation: FloatArray, counts: IntArray) -> BoolArray:
    """
    Return which fits of ``counts`` matches, made from ``before``, leave nothing to look for.

    ``before``, shape (B, 2), is psi and phi; they may have moved by ``deviation``; both, and
    ``counts``, have shape (B,).
    """
    change = np.abs(fit.parameters[:, :2] - before).max(axis=1)
    return np.asarray((fit.costs <= GOOD_COST * counts) & (change < deviation))


class Step(NamedTuple):
    """
    One step of Gauss-Newton: new parameters, (K, P), and what it saw before.

    Information, (K, P, P), ``squared`` distances, (K, N), how far the belief was ``away``, (K, P);
    ``length`` is the largest change of a parameter, (K,).
    """

    parameters: FloatArray
    information: FloatArray
    squared: FloatArray
    away: FloatArray
    length: FloatArray


def _step(problem: Problem, parameters: FloatArray, width: FloatArray | float) -> Step:
    """Return the step from ``parameters``, (K, P), with the noise ``width`` times larger."""
    belief = problem.belief
    rows, squared_gradient = linearised(problem.model(parameters), problem.table)
    squared = rows[:, 0] * rows[:, 0] / squared_gradient
    weight = np.maximum(1.0 - squared / (TUKEY * TUKEY * width * width), 0.0)
    weight *= weight
    weight /= squared_gradient
    normal = (rows * weight[:, None]) @ rows.swapaxes(1, 2)
    away = parameters - belief.mean
    information = normal[:, 1:, 1:] + problem.ridge
    change = _solved(information, normal[:, 1:, 0] + belief.information * away)
    length = np.maximum.reduce(np.abs(change), axis=1)
    if np.maximum.reduce(length) > LARGEST_STEP:
        change = np.clip(change, -LARGEST_STEP, LARGEST_STEP)
    return Step(parameters - change, information, squared, away, length)


def _fit(step: Step, problem: Problem, width: FloatArray | float) -> Fit:
    """Return the fits after ``step``, with the costs before it."""
    costs = np.minimum(step.squared / (width * width), INLIER_DEVIATIONS**2).sum(axis=1)
    costs += (step.away * step.away * problem.belief.information).sum(axis=1)
    return Fit(step.parameters, step.information, costs, step.squared)


def _left(iteration: int, annealing: int) -> float:
    """Return how much of a wide start is left in iteration 1, 2, ..."""
    return max(0.0, 1.0 - (iteration - 1) / annealing)


def _solved(information: FloatArray, pull: FloatArray) -> FloatArray:
    """Return the solutions of stacked normal equations, shape (K, P), nan where singular."""
    try:
        return np.asarray(np.linalg.solve(information, pull[:, :, None])[:, :, 0])
    except np.linalg.LinAlgError:
        if len(pull) == 1:
            return np.full_like(pull, np.nan)
    alone = [_solved(information[k : k + 1], pull[k : k + 1]) for k in range(len(pull))]
    return np.concatenate(alone)
