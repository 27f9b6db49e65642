"""Two degrees of freedom: planar motion, known focal length, upright camera."""

from collections.abc import Sequence

import numpy as np

from visual_servo_epipolar.core.arrays import BoolArray, FloatArray
from visual_servo_epipolar.core.estimators.base import Estimate, Prior
from visual_servo_epipolar.core.estimators.machinery.batch import (
    alone,
    Answer,
    answers,
    Method,
    Views,
    views_of,
)
from visual_servo_epipolar.core.estimators.machinery.hypotheses import (
    chosen_mode,
    FAMILIES,
    fused,
    INLIER_DEVIATIONS,
    modes,
    plausible,
    Rays,
    scores,
    two_point_hypotheses,
    undetermined,
)
from visual_servo_epipolar.core.estimators.machinery.refinement import (
    Belief,
    Fit,
    followed,
    NEGLIGIBLE,
    problem,
    refined,
)
from visual_servo_epipolar.core.estimators.machinery.sampson import table_of
from visual_servo_epipolar.core.geometry.cheirality import balances, oriented
from visual_servo_epipolar.core.geometry.epipolar import Bearings, fundamentals

MIN_MATCHES = 3
PAIRS = 130  # of matches: with 40 % outliers, 47 of them are good
MODES = 2
NOTHING = Belief(np.zeros(2), np.zeros(2))


def planar_2dof(
    current: FloatArray,
    desired: FloatArray,
    *,
    noise: float,
    prior: Prior,
    rng: np.random.Generator,
) -> Estimate:
    """
    Estimate (psi, phi) by all pairs of matches, MSAC, and Gauss-Newton on the Sampson distance.

    On general scenes it reaches the Cramer-Rao bound of two views; on one dominant vertical plane
    two solutions exist, and the one nearer to ``prior.bearings`` is taken. Where those fit at
    once, no other is looked for. A camera that is not upright (0.2 deg) biases it: use soft_planar
    then. ``rng`` is not needed.

    Raises
    ------
    DegenerateGeometryError
        With fewer than three matches, or all of them on the horizon, or no baseline at all.

    """
    del rng
    return alone(current, desired, noise, prior, METHOD)


def planar_2dof_each(
    current: FloatArray, desired: FloatArray, *, noise: FloatArray, priors: Sequence[Prior]
) -> list[Answer]:
    """Do the same for many pairs of views, rays of shape (B, N, 2) each; errors are answers."""
    return answers(views_of(current, desired, noise, priors), METHOD)


def _keep(views: Views) -> BoolArray:
    return plausible(views.rays, INLIER_DEVIATIONS * views.noise[:, None])


def _follow(views: Views, kept: BoolArray) -> Fit:
    shape = views.before.shape
    belief = Belief(np.zeros(shape), np.zeros(shape))
    return followed(
        views.before,
        problem(_model, table_of(views.rays, views.noise, kept), belief),
        negligible=NEGLIGIBLE * views.noise,
        scale=np.ones(len(views.noise)),
    )


def _search(rays: Rays, noise: float, prior: Prior) -> tuple[Fit, int, Bearings | None]:
    start = _candidates(rays, noise)
    found = refined(
        start, problem(_model, table_of(rays, noise), NOTHING), negligible=NEGLIGIBLE * noise
    )
    best, alternative = chosen_mode(found.parameters, found.costs, prior)
    return found, best, alternative


def _candidates(rays: Rays, noise: float) -> FloatArray:
    """Return psi and phi of the best hypotheses of different modes, shape (K, 2)."""
    hypotheses = two_point_hypotheses(rays, PAIRS)
    costs = scores(hypotheses, rays, INLIER_DEVIATIONS * noise)
    best = np.angle(hypotheses[:, modes(hypotheses, costs, MODES)])
    return np.asarray(best.T, dtype=np.float64)


def _model(angles: FloatArray) -> FloatArray:
    """Return F and its derivatives by psi and phi, shape (K, 3, 9)."""
    parts = np.exp(1j * angles).view(np.float64)  # cos psi, sin psi, cos phi, sin phi
    return np.asarray(parts @ FAMILIES).reshape(-1, 3, 9)


def _conclude(
    views: Views, kept: BoolArray, fit: Fit, rivals: Sequence[Bearings | None]
) -> list[Answer]:
    covariance = fit.covariance()
    angles, determined = fused(fit.parameters, covariance, views.before, views.deviation)
    agree = kept & (fit.squared <= INLIER_DEVIATIONS**2)
    numbers = np.exp(1j * angles)
    balance = balances(numbers, views.rays.u_a, views.rays.u_d, agree, views.noise)
    fundamental = fundamentals(numbers, balance)
    rows = zip(angles.tolist(), balance.tolist(), determined.tolist(), rivals, strict=True)
    return [
        Estimate(
            oriented(psi, phi, vote),
            fundamental[k],
            agree[k],
            min(abs(vote), 1.0),
            covariance[k],
            alternative=alternative,
        )
        if sure
        else undetermined()
        for k, ((psi, phi), vote, sure, alternative) in enumerate(rows)
    ]


METHOD = Method(MIN_MATCHES, _keep, _follow, _search, _conclude)
