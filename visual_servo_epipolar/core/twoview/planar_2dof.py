"""Two degrees of freedom: planar motion, known focal length, upright camera."""

from dataclasses import replace

import numpy as np

from visual_servo_epipolar.core.arrays import BoolArray, FloatArray
from visual_servo_epipolar.core.geometry.cheirality import oriented
from visual_servo_epipolar.core.geometry.epipolar import fundamentals
from visual_servo_epipolar.core.twoview.estimator import Estimate, Prior
from visual_servo_epipolar.core.twoview.hypotheses import (
    best_modes,
    choose_mode,
    FAMILIES,
    INLIER_DEVIATIONS,
    plausible,
    Rays,
    rays_of,
    remaining_rays,
    scores,
    two_point_hypotheses,
)
from visual_servo_epipolar.core.twoview.planar import (
    balances_in_front,
    concluded,
    from_last_bearings,
    PlanarModel,
    Posterior,
)
from visual_servo_epipolar.core.twoview.refinement import (
    GaussianPrior,
    refined,
)

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
    return from_last_bearings(MODEL, rays, matches, prior) or _search(rays, matches, prior)


def _search(rays: Rays, matches: BoolArray, prior: Prior) -> Estimate:
    """Estimate from hypotheses by pairs of the plausible ``matches``, shape (N,)."""
    remaining = remaining_rays(rays, matches, MIN_MATCHES)
    hypotheses = two_point_hypotheses(remaining, PAIRS)
    best = best_modes(hypotheses, scores(hypotheses, remaining), MODES)
    starts = np.angle(hypotheses[:, best]).T
    fits = refined(starts, MODEL.problem(remaining, prior))
    mode, alternative = choose_mode(fits.parameters, fits.costs, prior)
    estimate = concluded(MODEL, rays, matches, fits.take(mode).of_all(matches), prior)
    return replace(estimate, alternative=alternative)


def _matrices(angles: FloatArray) -> FloatArray:
    """Return F and its derivatives by psi and phi, shape (..., 2), as rows: (..., 3, 9)."""
    parts = np.exp(1j * angles).view(np.float64)  # cos psi, sin psi, cos phi, sin phi
    return np.asarray(parts @ FAMILIES).reshape(*angles.shape[:-1], 3, 9)


def _conclude(rays: Rays, agree: BoolArray, after: Posterior, prior: Prior) -> Estimate:
    phasors = np.exp(1j * after.parameters)
    vote, ahead = balances_in_front(phasors, rays, agree)
    psi, phi = after.parameters.tolist()
    balance = float(vote)
    return Estimate(
        oriented(psi, phi, balance),
        fundamentals(phasors, vote),
        ahead,
        min(abs(balance), 1.0),
        after.covariance,
    )


MODEL = PlanarModel(MIN_MATCHES, _matrices, lambda prior: NO_PRIOR, _conclude)
