"""Two degrees of freedom: planar motion, known focal length, upright camera."""

import numpy as np

from visual_servo_epipolar.core.arrays import FloatArray
from visual_servo_epipolar.core.epipolar import Bearings, cheirality, fundamental_from_bearings
from visual_servo_epipolar.core.errors import DegenerateGeometryError
from visual_servo_epipolar.core.estimators.base import Estimate, Prior
from visual_servo_epipolar.core.estimators.planar import (
    diverse,
    forms,
    INLIER_DEVIATIONS,
    linearise,
    Rays,
    rays_of,
    scores,
    tukey,
    two_point_hypotheses,
)

MIN_MATCHES = 3
PAIRS = 325  # all of 26 matches
MODES = 2
MODE_SPREAD = 0.07  # [rad]
ITERATIONS = 4


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
    two solutions exist, and the one nearer to ``prior.bearings`` is taken. A camera that is not
    upright (0.2 deg) biases it: use soft_planar then. ``rng`` is not needed.

    Raises
    ------
    DegenerateGeometryError
        With fewer than three matches, or all of them on the horizon.

    """
    del rng
    rays = rays_of(current, desired)
    candidates = _candidates(rays, noise, prior)
    psi, phi, costs = _refined(candidates, rays, noise)
    best, rival = chosen_mode(psi, phi, costs, noise, prior)
    return _estimate(psi[best], phi[best], rival, current, desired, noise)


def _candidates(rays: Rays, noise: float, prior: Prior) -> FloatArray:
    """Return the best hypotheses of different modes, shape (K, 4)."""
    found = two_point_hypotheses(rays, PAIRS) if len(rays.u_a) >= MIN_MATCHES else np.empty((0, 4))
    if not len(found):
        raise DegenerateGeometryError(
            f'bearings need {MIN_MATCHES} matches off the horizon, got {len(rays.u_a)} in all; '
            "track features above and below the camera's height"
        )
    if prior.bearings is not None:
        psi, phi = prior.bearings.psi, prior.bearings.phi
        found = np.vstack([found, [np.cos(psi), np.sin(psi), np.cos(phi), np.sin(phi)]])
    costs = scores(found, forms(rays), INLIER_DEVIATIONS * noise)
    return diverse(found, costs, MODES, spread=MODE_SPREAD)


def _refined(
    candidates: FloatArray, rays: Rays, noise: float
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Return psi, phi and truncated cost of each candidate after Gauss-Newton, shape (K,)."""
    psi = np.arctan2(candidates[:, 1], candidates[:, 0])[:, None]
    phi = np.arctan2(candidates[:, 3], candidates[:, 2])[:, None]
    for _ in range(ITERATIONS):
        at = linearise(psi, phi, rays)
        weight = tukey(at.distance, noise)
        step = _solved(at.by_psi, at.by_phi, weight, at.distance)
        psi, phi = psi - step[0], phi - step[1]
    squared = linearise(psi, phi, rays).distance ** 2
    costs = np.minimum(squared, (INLIER_DEVIATIONS * noise) ** 2).sum(axis=1)
    return psi[:, 0], phi[:, 0], costs


def _solved(
    by_psi: FloatArray, by_phi: FloatArray, weight: FloatArray, distance: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Solve the weighted 2x2 normal equations of each candidate in closed form, (K, 1) each."""
    weighted_psi, weighted_phi = weight * by_psi, weight * by_phi
    a = (weighted_psi * by_psi).sum(axis=1, keepdims=True)
    b = (weighted_psi * by_phi).sum(axis=1, keepdims=True)
    c = (weighted_phi * by_phi).sum(axis=1, keepdims=True)
    x = (weighted_psi * distance).sum(axis=1, keepdims=True)
    y = (weighted_phi * distance).sum(axis=1, keepdims=True)
    damping = 1e-9 * (a + c) + 1e-300
    a, c = a + damping, c + damping
    determinant = a * c - b * b
    limit = 0.2  # a longer step leaves the region where the linearisation means anything [rad]
    return (
        np.clip((c * x - b * y) / determinant, -limit, limit),
        np.clip((a * y - b * x) / determinant, -limit, limit),
    )


def chosen_mode(
    psi: FloatArray, phi: FloatArray, costs: FloatArray, noise: float, prior: Prior
) -> tuple[int, Bearings | None]:
    """
    Return the index of the best mode, and a rival that the data alone do not rule out.

    Costs are in ray units; two modes are on a par when their costs differ by less than what three
    matches may add by chance.
    """
    total = costs / noise**2
    if prior.bearings is not None:
        away = np.sin(psi - prior.bearings.psi) ** 2 + np.sin(phi - prior.bearings.phi) ** 2
        total = total + np.minimum(away / prior.deviation**2, 2.0 * len(costs) + 40.0)
    best = int(np.argmin(total))
    for other in np.argsort(costs):
        apart = max(abs(np.sin(psi[other] - psi[best])), abs(np.sin(phi[other] - phi[best])))
        close = costs[other] - costs[best] < 3.0 * INLIER_DEVIATIONS**2 * noise**2
        if other != best and close and apart > np.sin(MODE_SPREAD):
            return best, Bearings(float(psi[other]), float(phi[other]))
    return best, None


def _estimate(
    psi: float,
    phi: float,
    rival: Bearings | None,
    current: FloatArray,
    desired: FloatArray,
    noise: float,
) -> Estimate:
    at = linearise(np.array([[psi]]), np.array([[phi]]), rays_of(current, desired))
    inliers = (np.abs(at.distance[0]) <= INLIER_DEVIATIONS * noise) & (
        at.side_a[0] * at.side_d[0] < 0.0
    )
    jacobian = np.stack([at.by_psi[0], at.by_phi[0]]) * np.sqrt(tukey(at.distance[0], noise))
    covariance = noise**2 * np.linalg.pinv(jacobian @ jacobian.T)
    vote = cheirality(Bearings(psi, phi), current[inliers], desired[inliers], noise=noise)
    fundamental = fundamental_from_bearings(vote.bearings)
    return Estimate(vote.bearings, fundamental, inliers, vote.confidence, covariance, rival=rival)
