"""
Least squares: the one loop, normal equations, weights of outliers, linear fits, samples, noise.

Callers state residuals and Jacobian at some unknowns, and what a change does to these.
"""

from collections.abc import Callable
import math
from typing import NamedTuple, Protocol, TypeVar

import numpy as np

from visual_servo_epipolar.core.arrays import FloatArray, IntArray, NORMAL

USUAL_SQUARES = 1.3863  # median of sums of two squares of normal noise of deviation 1: 2 log 2
CONTRADICTING = 16.0  # square, in deviations, that noise does not explain
TUKEY = 4.685  # deviations from which residuals count no more: 95 % efficient for normal noise
REWEIGHTINGS = 6  # rounds in which robust weights settle
SMALLEST = 1e-18  # squared residual by which weights are scaled at least
RIDGE = 1e-6  # that keeps equations regular where matches coincide, or lie in a row
STEP = 1.25  # ratio of a noise that is compared to the next
POWERS = np.arange(-4.0, 8.0)  # of it, times what noise is taken for
SPENT = 4  # parameters that the fit spends on noise
RIGHT, ANYWHERE_PX = 0.8, 60.0  # share of matches that are right; among how many px others are
ROOT_2_PI = math.sqrt(2.0 * math.pi)


class Equations(NamedTuple):
    """Normal equations of P unknowns: ``information``, (..., P, P), and ``pull``, (..., P)."""

    information: FloatArray
    pull: FloatArray

    @classmethod
    def of(cls, rows: FloatArray, ridge: FloatArray | float = 0.0) -> 'Equations':
        """
        Return those of N residuals and their derivatives as ``rows``, (..., 1 + P, N).

        Each column is times the root of its weight; ``ridge``, (P, P), is information of a prior
        that draws to no change.
        """
        normal = rows @ rows.swapaxes(-2, -1)
        return cls(normal[..., 1:, 1:] + ridge, normal[..., 1:, 0])

    def change(self) -> FloatArray:
        """Return by what unknowns are too large, (..., P); nan where equations are singular."""
        try:
            return np.asarray(np.linalg.solve(self.information, self.pull[..., None])[..., 0])
        except np.linalg.LinAlgError:
            if self.pull.ndim == 1:
                return np.full_like(self.pull, np.nan)
        return np.array([Equations(*each).change() for each in zip(*self, strict=True)])


class Damped(NamedTuple):
    """Equations of P unknowns whose change is shorter where little is known of them."""

    equations: Equations
    damping: float

    def change(self) -> FloatArray:
        """Return the change, (P,) (Levenberg, Marquardt)."""
        information, pull = self.equations
        scale = 1.0 / np.sqrt(np.diag(information))
        matrix = information * scale * scale[:, None]
        matrix[np.diag_indices_from(matrix)] += self.damping
        return np.asarray(scale * np.linalg.solve(matrix, scale * pull))


class Linearised(Protocol):
    """What a caller finds at some unknowns: ``Equations``, or what holds more beside these."""

    def change(self) -> FloatArray:
        """Return by what unknowns are too large."""
        ...


Unknowns = TypeVar('Unknowns')
Found = TypeVar('Found', bound=Linearised)


def least_squares(
    start: Unknowns,
    linearise: Callable[[Unknowns, int], Found],
    moved: Callable[[Unknowns, Found, FloatArray], tuple[Unknowns, bool]],
    rounds: int,
) -> tuple[Unknowns, Found]:
    """
    Return unknowns after one to ``rounds`` steps of Gauss and Newton, and what the last found.

    ``linearise`` is given unknowns and the number of the round; ``moved`` what it found and the
    change, and returns the next unknowns and whether they are the last.
    """
    unknowns = start
    for number in range(rounds):
        found = linearise(unknowns, number)
        unknowns, last = moved(unknowns, found, found.change())
        if last:
            break
    return unknowns, found


def cauchy(squares: FloatArray, scale: FloatArray | float) -> FloatArray:
    """Return by how much residuals count (Cauchy); its square is Geman and McClure's weight."""
    weight = squares / np.maximum(scale, SMALLEST)
    weight += 1.0
    return np.asarray(np.divide(1.0, weight, out=weight))


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
    ridge: float = 0.0,
) -> LinearFit | None:
    """Return the fit reweighted by what it leaves, (N, ...); None where columns look alike."""
    weight, fit = np.ones(len(values)), None
    for _ in range(rounds):
        condition = np.linalg.cond(columns.T @ (weight[:, None] * columns)) if not ridge else 1.0
        if condition * np.finfo(np.float64).eps > 1.0:
            return None
        fit = linear_fit(columns, values, weight, ridge)
        weight = weigh(fit.residual)
    return fit


def null_vector(rows: FloatArray, weight: FloatArray | None = None) -> FloatArray:
    """Return the unit vectors, (..., P), that rows, (..., N, P), by ``weight``, bring to least."""
    weighted = rows if weight is None else rows * weight[..., None]
    return np.asarray(np.linalg.eigh(rows.swapaxes(-1, -2) @ weighted)[1][..., 0])


def deviation_of(median: float, spare: float = math.inf) -> float:
    """Return the deviation of noise of which so many ``spare`` residuals have the ``median``."""
    return NORMAL * (1.0 + 5.0 / max(spare, 1)) * median  # Rousseeuw and Leroy 1987


def likeliest_noise(distances: FloatArray, noise: float) -> float:
    """
    Return the deviation [px] by which ``distances``, (N,) [px], are likeliest, near ``noise``.

    The others are anywhere. A fit of many parameters to few matches leaves out those that do not
    suit it: as wrong ones, if noise is taken for small. They would lie farther off than they do.
    """
    scales = noise * STEP**POWERS
    squared = (distances / scales[:, None]) ** 2
    density = RIGHT / (scales * ROOT_2_PI)[:, None] * np.exp(-0.5 * squared)
    losses = -np.log(density + (1.0 - RIGHT) / ANYWHERE_PX).sum(axis=1)
    best = min(max(int(losses.argmin()), 1), len(POWERS) - 2)
    before, least, after = losses[best - 1 : best + 2].tolist()
    curvature = before - 2.0 * least + after
    aside = 0.5 * (before - after) / curvature if curvature > 0.0 else 0.0
    spent = len(distances) / max(len(distances) - SPENT, 1)
    power = POWERS[best] + min(max(aside, -1.0), 1.0)
    return noise * float(STEP**power) * math.sqrt(spent)


def samples(rng: np.random.Generator, limit: int, count: int, size: int) -> IntArray:
    """Return ``limit`` samples of ``size`` different ones of ``count``, shape (limit, size)."""
    return np.asarray(rng.random((limit, count)).argsort(axis=1)[:, :size])
