"""
Least squares on the Sampson distance, for many epipolar geometries at once.

A model turns parameters into a stack of matrices by rows, E and its derivatives by P parameters,
shape (K, 1 + P, 9). Residual and gradient of p_d^T E p_a are linear in E, so that one product with
a table of the matches gives them all, whatever the parameters mean.
"""

from collections.abc import Callable
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from visual_servo_epipolar.core.arrays import FloatArray
from visual_servo_epipolar.core.errors import DegenerateGeometryError
from visual_servo_epipolar.core.estimators.base import Prior
from visual_servo_epipolar.core.estimators.planar import (
    INLIER_DEVIATIONS,
    MARGIN,
    modes,
    Rays,
    RIVAL_COST,
    SPREAD,
)

TUKEY = 4.685  # 95 % efficient for Gaussian noise
LARGEST_STEP = 0.2  # a longer one leaves where the linearisation means anything [rad]
NEGLIGIBLE = 0.3  # step that ends the iterations, in deviations of the noise: the next is tiny
ANNEALING = 3  # steps until a wide start has narrowed to the noise
ITERATIONS = 9
ROUGH, MODES = 3, 3  # steps with all modes, and how many may go on
RIDGE = 1e-3  # information that keeps normal matrices regular: a deviation of 30 rad
GOOD_COST = 1.8  # of a match, in squared deviations: noise, and outliers fewer than one in six

Model = Callable[[FloatArray], FloatArray]


def table_of(rays: Rays, noise: float) -> FloatArray:
    """
    Return the matches as columns for products with matrices, shape (9, 5 N).

    The five are the residual p_d^T E p_a in deviations of ``noise``, two components of E p_a, and
    two of E^T p_d.
    """
    count = len(rays.u_a)
    p_a, p_d = np.ones((3, count)), np.ones((3, count))
    p_a[0], p_a[1], p_d[0], p_d[1] = rays
    table = np.zeros((3, 3, 5, count))
    table[:, :, 0] = (p_d / noise)[:, None] * p_a
    table[0, :, 1] = table[1, :, 2] = p_a
    table[:, 0, 3] = table[:, 1, 4] = p_d
    return table.reshape(9, 5 * count)


class Belief(NamedTuple):
    """What is known of the parameters beforehand: mean and information, shape (P,) each."""

    mean: FloatArray
    information: FloatArray


@dataclass(frozen=True, slots=True, eq=False)
class Fit:
    """
    Refined parameters, (K, P), their information, (K, P, P), and their costs, (K,).

    ``squared`` distances, (K, N), and costs are in deviations of the noise; a cost is the sum of
    the truncated ones, and the price of leaving the belief.
    """

    parameters: FloatArray
    information: FloatArray
    costs: FloatArray
    squared: FloatArray

    def goes_on(self, prior: Prior) -> bool:
        """Return whether the first fit, made from ``prior``, leaves nothing to look for."""
        if prior.bearings is None or self.costs[0] > GOOD_COST * self.squared.shape[1]:
            return False
        psi, phi = self.parameters[0, :2].tolist()
        change = max(abs(psi - prior.bearings.psi), abs(phi - prior.bearings.phi))
        return bool(change < prior.deviation)

    def winnowed(self) -> FloatArray:
        """Return the parameters of the best different modes among those that may still win."""
        worst = INLIER_DEVIATIONS**2 * self.squared.shape[1]
        margin = min(MARGIN, 2.0 * RIVAL_COST / worst)
        numbers = np.exp(1j * self.parameters[:, :2].T)
        best = modes(numbers, self.costs / worst, MODES, spread=0.25 * SPREAD, margin=margin)
        return np.asarray(self.parameters[best])

    def covariance(self, place: int) -> FloatArray:
        """Return the covariance of the parameters of one fit, shape (P, P)."""
        return np.asarray(np.linalg.inv(self.information[place]))


def refined(
    start: FloatArray,
    model: Model,
    table: FloatArray,
    belief: Belief,
    *,
    negligible: float,
    scale: float = 1.0,
) -> Fit:
    """
    Minimise the robust Sampson distance from each ``start``, shape (K, P), by Gauss-Newton.

    The first steps take the noise for ``scale`` times larger: they must not lose matches that
    the other parameters will bring back. Then only the best different modes go on, until a step
    is ``negligible``.
    """
    parameters, ridge = start, np.diag(belief.information + RIDGE)
    first = ROUGH if scale > 1.0 else 1
    for iteration in range(1, ITERATIONS + 1):
        width = 1.0 + (scale - 1.0) * max(0.0, 1.0 - (iteration - 1) / ANNEALING)
        rows, squared_gradient = _linearised(model(parameters), table)
        squared = rows[:, 0] * rows[:, 0] / squared_gradient
        weight = np.maximum(1.0 - squared * (TUKEY * width) ** -2.0, 0.0)
        weight *= weight
        weight /= squared_gradient
        normal = (rows * weight[:, None]) @ rows.swapaxes(1, 2)
        information = normal[:, 1:, 1:] + ridge
        away = parameters - belief.mean
        pull = normal[:, 1:, 0] + belief.information * away
        step = _solved(information, pull)
        largest = float(np.abs(step).max())
        if largest > LARGEST_STEP:
            step = np.clip(step, -LARGEST_STEP, LARGEST_STEP)
        parameters = parameters - step
        done = iteration == ITERATIONS or (width == 1.0 and largest < negligible)
        if done or (len(parameters) > 1 and iteration >= first):
            costs = np.minimum(squared / width**2, INLIER_DEVIATIONS**2).sum(axis=1)
            costs += away * away @ belief.information
            fit = Fit(parameters, information, costs, squared)
            if done:
                break
            parameters = fit.winnowed()
    return fit


def _solved(information: FloatArray, pull: FloatArray) -> FloatArray:
    try:
        return np.asarray(np.linalg.solve(information, pull[:, :, None])[:, :, 0])
    except np.linalg.LinAlgError as error:
        raise DegenerateGeometryError(
            'the normal equations of the matches are singular; check the camera matrix, the rays '
            'are far from unit focal length'
        ) from error


def _linearised(stack: FloatArray, table: FloatArray) -> tuple[FloatArray, FloatArray]:
    """
    Return residuals r and g times the derivatives of r / g, (K, 1 + P, N), and g^2, (K, N).

    g is the norm of the gradient of r, so that r / g is the Sampson distance.
    """
    count, size, _ = stack.shape
    values = (stack.reshape(-1, 9) @ table).reshape(count, size, 5, -1)
    lines = values[:, :, 1:]
    products = (lines[:, :1] * lines).sum(axis=2)  # g^2, and half its derivatives
    squared_gradient = products[:, 0] + 1e-12
    products *= (values[:, 0, 0] / squared_gradient)[:, None]
    products[:, 0] = 0.0
    return values[:, :, 0] - products, squared_gradient
