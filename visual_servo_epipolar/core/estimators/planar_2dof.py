"""Two degrees of freedom: planar motion, known focal length, upright camera."""

from functools import partial

import numpy as np

from visual_servo_epipolar.core.arrays import BoolArray, FloatArray
from visual_servo_epipolar.core.estimators.base import Estimate, Prior
from visual_servo_epipolar.core.estimators.machinery.conclusion import (
    balances_in_front,
    Conclusion,
    estimate_in_front,
)
from visual_servo_epipolar.core.estimators.machinery.gaussian import (
    GaussianPrior,
    Posterior,
    posterior,
)
from visual_servo_epipolar.core.estimators.machinery.hypotheses import (
    best_modes,
    choose_mode,
    FAMILIES,
    INLIER_DEVIATIONS,
    plausible,
    Rays,
    rays_of,
    scores,
    too_few,
    two_point_hypotheses,
)
from visual_servo_epipolar.core.estimators.machinery.refinement import (
    Fit,
    is_consistent,
    NEGLIGIBLE,
    problem_of,
    refined,
    refined_modes,
)
from visual_servo_epipolar.core.estimators.machinery.sampson import table_of
from visual_servo_epipolar.core.geometry.cheirality import oriented
from visual_servo_epipolar.core.geometry.epipolar import Bearings, fundamentals

MIN_MATCHES = 3
PAIRS = 130  # of matches: with 40 % outliers, 47 of them are good
MODES = 2
NO_PRIOR = GaussianPrior(np.zeros(2), np.zeros((2, 2)))


def planar_2dof(
    current: FloatArray,
    desired: FloatArray,
    *,
    noise: FloatArray | float,
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
    rays = rays_of(current, desired, noise)
    matches = plausible(rays, INLIER_DEVIATIONS * rays.noise)
    count = int(matches.sum())
    if prior.bearings is not None and count >= MIN_MATCHES:
        fit = _refined(rays, matches, prior.angles)
        if is_consistent(fit, prior.angles, prior.deviation, count):
            return _estimate(rays, matches, fit, prior)
    return search(rays, matches, prior)


def search(rays: Rays, matches: BoolArray, prior: Prior) -> Estimate:
    """Estimate from hypotheses by pairs of the plausible ``matches``, shape (N,)."""
    remaining = rays.take(matches)
    if remaining.matches < MIN_MATCHES:
        raise too_few(remaining.matches, rays.matches, MIN_MATCHES)
    hypotheses = two_point_hypotheses(remaining, PAIRS)
    costs = scores(hypotheses, remaining)
    best = best_modes(hypotheses, costs, MODES)
    fits = refined_modes(
        np.angle(hypotheses[:, best]).T,
        problem_of(model, table_of(remaining), NO_PRIOR),
        negligible=float(NEGLIGIBLE * remaining.mean_noise),
    )
    mode, alternative = choose_mode(fits.parameters, fits.costs, prior)
    fit = fits.take(mode).of_all(matches)
    return _estimate(rays, matches, fit, prior, alternative)


def model(angles: FloatArray) -> FloatArray:
    """Return F and its derivatives by psi and phi, shape (..., 2), as rows: (..., 3, 9)."""
    parts = np.exp(1j * angles).view(np.float64)  # cos psi, sin psi, cos phi, sin phi
    return np.asarray(parts @ FAMILIES).reshape(*angles.shape[:-1], 3, 9)


def _estimate(
    rays: Rays,
    matches: BoolArray,
    fit: Fit,
    prior: Prior,
    alternative: Bearings | None = None,
) -> Estimate:
    def concluded(matches: BoolArray, fit: Fit) -> Estimate:
        after = posterior(fit.parameters, fit.covariance(), prior.angles, prior.deviation)
        agree = matches & (fit.squared <= INLIER_DEVIATIONS**2)
        return estimate_of(conclude(rays, agree, after), alternative)

    return estimate_in_front(matches, fit, concluded, partial(_refined, rays))


def _refined(rays: Rays, matches: BoolArray, start: FloatArray) -> Fit:
    return refined(
        start,
        problem_of(model, table_of(rays, matches), NO_PRIOR),
        negligible=float(NEGLIGIBLE * rays.mean_noise),
        scale=1.0,
    )


def conclude(rays: Rays, agree: BoolArray, after: Posterior) -> Conclusion:
    """Return the oriented geometry, shape (...), of matches that ``agree``, (..., N)."""
    phasors = np.exp(1j * after.parameters)
    balance, ahead = balances_in_front(phasors, rays, agree)
    return Conclusion(*after, ahead, balance, fundamentals(phasors, balance))


def estimate_of(conclusion: Conclusion, alternative: Bearings | None = None) -> Estimate:
    """Return what is concluded of one pair of views as an estimate, if it is determined."""
    conclusion.require_determined()
    psi, phi = conclusion.parameters.tolist()
    balance = float(conclusion.balance)
    return Estimate(
        oriented(psi, phi, balance),
        conclusion.fundamental,
        conclusion.inliers,
        min(abs(balance), 1.0),
        conclusion.covariance,
        alternative=alternative,
    )
