"""
Gauss-Newton on the Sampson distance: from one start, or from many of which the best modes go on.

The residual p_d^T E p_a of unit rays and its gradient in the planes that touch the unit sphere are
linear in E, so that one product with a table of the matches gives them all, and their derivatives
by the parameters of E, whatever these mean.

The noise of a ray is assumed equal along all directions across it, with a deviation of its own
(see ``Camera.resolution``). The noise of a pixel is not quite that: off the axis of a pinhole its
angle is less along the radius, by the cosine. Knowing it exactly gained nothing in 800 pairs over
79 deg of view (0.242 / 0.77 deg both ways), and every caller would have to pass two vectors a ray.
Where it matters, at a focal length many times too short, ``image_axes`` has the exact ones.
"""

from collections.abc import Callable
import math
from typing import Any, NamedTuple

import numpy as np

from visual_servo_epipolar.core.arrays import BoolArray, FloatArray, IntArray, TINY
from visual_servo_epipolar.core.errors import DegenerateGeometryError
from visual_servo_epipolar.core.geometry.least_squares import Equations, least_squares, TUKEY
from visual_servo_epipolar.core.geometry.rays import Axes, image_axes, tangents
from visual_servo_epipolar.core.twoview.estimator import Prior
from visual_servo_epipolar.core.twoview.hypotheses import (
    ALTERNATIVE_COST,
    best_modes,
    MARGIN,
    Rays,
    SEPARATION,
    WORST,
)
from visual_servo_epipolar.core.twoview.planar_motion import GaussianPrior, known_before, matrices

LARGEST_STEP = 0.2  # a longer one leaves where the linearisation means anything [rad]
NEGLIGIBLE = 0.3  # step that ends the iterations, in deviations of the noise: the next is tiny
ANNEALING = 2  # steps until a wide start has narrowed to the noise; one more with all modes
ITERATIONS = 9
MODES = 3  # how many may go on
LEVERAGE, LEAST_SPARE = 0.5, 1e-4  # of a match that nothing speaks for; what others leave it
RIDGE = 1e-3  # information that keeps normal matrices regular: a deviation of 30 rad


class Problem(NamedTuple):
    """What is minimised: distances of the ``table`` of matches, and the ``prior``."""

    table: FloatArray  # shape (9, 5 N)
    prior: GaussianPrior
    ridge: FloatArray  # shape (P, P): the information of the prior, never zero
    negligible: float  # step that ends the iterations [rad]

    @classmethod
    def of(cls, rays: Rays, prior: Prior, plausible: BoolArray | None = None) -> 'Problem':
        """Return what is minimised to fit a planar motion to ``plausible`` matches, (N,)."""
        before = known_before(prior)
        ridge = before.information + RIDGE * np.eye(len(before.mean))
        negligible = float(NEGLIGIBLE * rays.mean_noise)
        axes = tangents if prior.lens.calibrated else image_axes
        return cls(table_of(rays, plausible, axes), before, ridge, negligible)


class Fit(NamedTuple):
    """
    Parameters, (..., P), their information, (..., P, P), and their costs, (...).

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
    Minimise the robust Sampson distance by Gauss-Newton from ``start``, shape (P,) or (K, P).

    One start is near the truth; of many only the best modes go on after a few steps. The first
    steps take the noise for ``scale`` times larger: they must not lose matches that the other
    parameters will bring back. It ends once steps are negligible. Singular equations give nan.

    Raises
    ------
    DegenerateGeometryError
        If the normal equations of many starts are singular.

    """
    many = start.ndim > 1
    rough = ANNEALING + 1 if scale > 1.0 else 1

    def linearise(parameters: FloatArray, number: int) -> Step:
        width = 1.0 + (scale - 1.0) * max(0.0, 1.0 - number / ANNEALING)  # at first wider
        return _step(problem, parameters, number, width)

    def moved(parameters: FloatArray, step: Step, change: FloatArray) -> tuple[FloatArray, bool]:
        longest = float(np.abs(change).max())
        if many and math.isnan(longest):
            raise DegenerateGeometryError(
                'the normal equations of the matches are singular; pass rays of unit length and '
                'their noise as an angle [rad]'
            )
        if longest > LARGEST_STEP:
            change = np.clip(change, -LARGEST_STEP, LARGEST_STEP)
        parameters, done = parameters - change, step.number + 1
        if done == ITERATIONS or not (step.width > 1.0 or longest >= problem.negligible):
            return parameters, True
        if many and len(parameters) > 1 and done >= rough:
            parameters = parameters[_best_modes(step.fit(parameters))]
        return parameters, False

    parameters, step = least_squares(start, linearise, moved, ITERATIONS)
    return step.fit(parameters)


def _best_modes(fit: Fit) -> IntArray:
    """Return the places of the best different modes among those that may still win."""
    worst = WORST * fit.squared.shape[1]
    return best_modes(
        fit.parameters[:, :2],
        fit.costs / worst,
        MODES,
        separation=0.25 * SEPARATION,
        margin=min(MARGIN, 2.0 * ALTERNATIVE_COST / worst),
    )


class Step(NamedTuple):
    """
    What a step of Gauss-Newton is made of.

    ``squared`` distances, (..., N), and ``slopes``, (..., P, N), are as a Fit has them;
    ``leaving`` is the price of leaving the prior, (...); in round ``number``, 0, 1, ..., the noise
    is taken for ``width`` times larger.
    """

    equations: Equations
    squared: FloatArray
    slopes: FloatArray
    leaving: FloatArray
    number: int
    width: float

    def change(self) -> FloatArray:
        """Return by what parameters are too large, (..., P)."""
        return self.equations.change()

    def fit(self, parameters: FloatArray) -> Fit:
        """Return the fits of ``parameters`` after the step, with the costs before it."""
        width = self.width
        costs = np.minimum(self.squared / (width * width), WORST).sum(axis=-1)
        costs += self.leaving
        return Fit(parameters, self.equations.information, costs, self.squared, self.slopes)


def _step(problem: Problem, parameters: FloatArray, number: int, width: float) -> Step:
    """Return what a step from ``parameters``, (..., P), is made of; Tukey's weights."""
    rows, squared_gradient = linearised(matrices(parameters), problem.table)
    squared = rows[..., 0, :] * rows[..., 0, :] / squared_gradient
    weight = np.maximum(1.0 - squared / (TUKEY * TUKEY * width * width), 0.0)
    # Tukey's weight is the square of this
    rows *= (weight / np.sqrt(squared_gradient))[..., None, :]
    information, pull = Equations.of(rows, problem.ridge)
    mean, known = problem.prior
    deviation = parameters - mean
    # Never a product of matrices: its bits would depend on how many geometries are side by side.
    prior_pull = (known * deviation[..., None, :]).sum(axis=-1)
    leaving = (deviation * prior_pull).sum(axis=-1)
    equations = Equations(information, pull + prior_pull)
    return Step(equations, squared, rows[..., 1:, :], leaving, number, width)


def table_of(
    rays: Rays, plausible: BoolArray | None = None, axes: Callable[..., Axes] = tangents
) -> FloatArray:
    """
    Return the matches as columns for products with matrices, shape (9, 5 N).

    The five are the residual p_d^T E p_a in deviations of the desired ray, two components of E p_a
    across the desired ray, and two of E^T p_d across the current ray, these times the ratio of the
    deviations. ``axes`` are those along which noise moves a ray. A match that is not
    ``plausible``, (N,), is a column of zeros: it costs and pulls nothing.
    """
    x, y, z = np.array([[rays.x_a, rays.x_d], [rays.y_a, rays.y_d], [rays.z_a, rays.z_d]])
    ratio = rays.noise_a / rays.noise_d
    # A column is the product of the desired ray, or an axis across it, and of the current one.
    desired, current = np.empty((2, 3, 5, rays.matches))
    for row, (ray, *across) in enumerate(zip((x, y, z), *axes(x, y, z), strict=True)):
        desired[row, 0] = ray[1] / rays.noise_d
        desired[row, 1], desired[row, 2] = across[0][1], across[1][1]
        desired[row, 3:] = ray[1] * ratio
        current[row, :3] = ray[0]
        current[row, 3], current[row, 4] = across[0][0], across[1][0]
    if plausible is not None and not plausible.all():
        desired *= plausible
    return np.asarray((desired[:, None] * current[None]).reshape(9, -1))


def squared_distances(matrices: FloatArray, table: FloatArray) -> FloatArray:
    """Return the squared Sampson distances from E by rows, shape (K, 9), of one table: (K, N)."""
    squares = (matrices @ table).reshape(len(matrices), 5, -1)
    squares *= squares
    return np.asarray(squares[:, 0] / (squares[:, 1:].sum(axis=1) + TINY))


def linearised(stack: FloatArray, table: FloatArray) -> tuple[FloatArray, FloatArray]:
    """
    Return residuals r and g times the derivatives of r / g, (..., 1 + P, N), and g^2, (..., N).

    g is the norm of the gradient of r, so that r / g is the Sampson distance. ``stack`` has shape
    (..., 1 + P, 9).
    """
    values = (stack.reshape(-1, 9) @ table).reshape(*stack.shape[:-1], 5, -1)
    lines = values[..., 1:, :]
    # g^2, and half its derivatives
    slopes = np.einsum('...ln,...pln->...pn', lines[..., 0, :, :], lines)
    squared_gradient = slopes[..., 0, :] + 1e-12
    slopes *= (values[..., 0, 0, :] / squared_gradient)[..., None, :]
    slopes[..., 0, :] = 0.0
    return np.subtract(values[..., 0, :], slopes, out=slopes), squared_gradient
