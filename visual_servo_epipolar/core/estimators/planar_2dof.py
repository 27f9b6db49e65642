"""Two degrees of freedom: planar motion, known focal length, upright camera."""

import numpy as np

from visual_servo_epipolar.core.arrays import BoolArray, FloatArray
from visual_servo_epipolar.core.cheirality import cheirality
from visual_servo_epipolar.core.epipolar import Bearings, fundamental_from_bearings
from visual_servo_epipolar.core.errors import DegenerateGeometryError
from visual_servo_epipolar.core.estimators.base import Estimate, Prior
from visual_servo_epipolar.core.estimators.planar import (
    chosen_mode,
    fused,
    INLIER_DEVIATIONS,
    modes,
    plausible,
    Rays,
    rays_of,
    scores,
    two_point_hypotheses,
)
from visual_servo_epipolar.core.estimators.sampson import (
    Belief,
    Fit,
    NEGLIGIBLE,
    refined,
    table_of,
)

MIN_MATCHES = 3
PAIRS = 130  # of matches: with 40 % outliers, 47 of them are good
MODES = 2
NOTHING = Belief(np.zeros(2), np.zeros(2))


def _families() -> FloatArray:
    """Return the constants that turn (p0, p1, q0, q1) into F, dF/dpsi and dF/dphi, (4, 27)."""
    made = np.zeros((4, 3, 3, 3))
    p0, p1, q0, q1 = made
    # F = [[0, -p1, 0], [q0, 0, q1], [0, p0, 0]]; d(p0, p1)/dpsi = (-p1, p0).
    p1[0, 0, 1], q0[0, 1, 0], q1[0, 1, 2], p0[0, 2, 1] = -1.0, 1.0, 1.0, 1.0
    p0[1, 0, 1], p1[1, 2, 1] = -1.0, -1.0
    q1[2, 1, 0], q0[2, 1, 2] = -1.0, 1.0
    return made.reshape(4, 27)


FAMILIES = _families()


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
    rays = rays_of(current, desired)
    kept = plausible(rays, INLIER_DEVIATIONS * noise)
    if not kept.all():
        rays = Rays(*(coordinate[kept] for coordinate in rays))
    if len(rays.u_a) < MIN_MATCHES:
        raise DegenerateGeometryError(
            f'bearings need {MIN_MATCHES} matches on one side of the horizon in both views, got '
            f'{len(rays.u_a)} of {len(kept)}; track more features'
        )
    table = table_of(rays, noise)
    if prior.bearings is not None:
        before = np.array([[prior.bearings.psi, prior.bearings.phi]])
        found = _refined(before, table, noise)
        if found.goes_on(prior):
            return _estimate(found, 0, None, rays, kept, noise, prior)
    found = _refined(_candidates(rays, noise), table, noise)
    best, rival = chosen_mode(found.parameters, found.costs, prior)
    return _estimate(found, best, rival, rays, kept, noise, prior)


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


def _refined(start: FloatArray, table: FloatArray, noise: float) -> Fit:
    return refined(start, _model, table, NOTHING, negligible=NEGLIGIBLE * noise)


def _estimate(
    found: Fit,
    best: int,
    rival: Bearings | None,
    rays: Rays,
    kept: BoolArray,
    noise: float,
    prior: Prior,
) -> Estimate:
    covariance = found.covariance(best)
    psi, phi = fused(found.parameters[best], covariance, prior).tolist()
    agree = found.squared[best] <= INLIER_DEVIATIONS**2
    inliers = kept.copy()
    inliers[kept] = agree
    u_a, v_a, u_d, v_d = np.array(rays)[:, agree]
    current, desired = np.array([u_a, v_a]).T, np.array([u_d, v_d]).T
    vote = cheirality(Bearings(psi, phi), current, desired, noise=noise)
    fundamental = fundamental_from_bearings(vote.bearings)
    return Estimate(vote.bearings, fundamental, inliers, vote.confidence, covariance, rival=rival)
