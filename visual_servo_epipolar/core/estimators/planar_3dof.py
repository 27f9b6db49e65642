"""Three degrees of freedom: planar motion, upright camera, focal length unknown."""

import math

import numpy as np

from visual_servo_epipolar.core.arrays import FloatArray
from visual_servo_epipolar.core.epipolar import Bearings, cheirality
from visual_servo_epipolar.core.errors import DegenerateGeometryError
from visual_servo_epipolar.core.estimators.base import Estimate, Prior
from visual_servo_epipolar.core.estimators.planar import (
    diverse,
    Forms,
    forms,
    INLIER_DEVIATIONS,
    rays_of,
    scores,
    squared_distances,
    tukey,
)

MIN_MATCHES = 4
TRIPLES = 400
MODES = 3
MODE_SPREAD = 0.07  # [rad]
ITERATIONS = 5


def planar_3dof(
    current: FloatArray,
    desired: FloatArray,
    *,
    noise: float,
    prior: Prior,
    rng: np.random.Generator,
) -> Estimate:
    """
    Estimate h = (p0, p1, q0, q1) up to scale, with |q| / |p| free, from triples of matches.

    A wrong focal length scales u and v alike and is absorbed by |q| / |p|: the epipoles in pixels
    stay right, though the bearings are those of the wrong camera. On a vertical plane every such
    geometry fits, so that scenes of one wall need a known focal length. ``rng`` draws the triples.

    Raises
    ------
    DegenerateGeometryError
        With fewer than four matches, or all of them on the horizon.

    """
    del prior
    if len(current) < MIN_MATCHES:
        raise DegenerateGeometryError(
            f'bearings need {MIN_MATCHES} matches, got {len(current)}; track more features'
        )
    rows = forms(rays_of(current, desired))
    found = _three_point_hypotheses(rows, rng)
    if not len(found):
        raise DegenerateGeometryError(
            'all matches lie on the horizon, where planar motion does not show; '
            "track features above and below the camera's height"
        )
    start = diverse(
        found, scores(found, rows, INLIER_DEVIATIONS * noise), MODES, spread=MODE_SPREAD
    )
    refined = np.array([_refined(h, rows, noise) for h in start])
    best = refined[int(np.argmin(scores(refined, rows, INLIER_DEVIATIONS * noise)))]
    return _estimate(best, rows, current, desired, noise)


def _three_point_hypotheses(rows: Forms, rng: np.random.Generator) -> FloatArray:
    """Return the null vector of three rows of the constraint each, shape (H, 4), by cofactors."""
    count = rows.linear.shape[1]
    picks = np.argsort(rng.random((TRIPLES, count)), axis=1)[:, :3]
    a, b, c = (rows.linear.T[picks[:, k]] for k in range(3))
    found = np.empty((TRIPLES, 4))
    for k in range(4):
        x, y, z = (column for column in range(4) if column != k)
        found[:, k] = (-1.0) ** k * (
            a[:, x] * (b[:, y] * c[:, z] - b[:, z] * c[:, y])
            - a[:, y] * (b[:, x] * c[:, z] - b[:, z] * c[:, x])
            + a[:, z] * (b[:, x] * c[:, y] - b[:, y] * c[:, x])
        )
    norm = np.linalg.norm(found, axis=1)
    found = found[norm > 0.0] / norm[norm > 0.0, None]
    return np.asarray(found)


def _refined(start: FloatArray, rows: Forms, noise: float) -> FloatArray:
    """Minimise the robust Sampson distance by reweighted eigenvectors, shape (4,)."""
    h = start
    for _ in range(ITERATIONS):
        squared = squared_distances(h[None], rows)[0]
        gradient = np.maximum((h @ rows.linear) ** 2 / np.maximum(squared, 1e-300), 1e-12)
        weight = tukey(np.sqrt(squared), noise) / gradient
        h = np.linalg.eigh((rows.linear * weight) @ rows.linear.T)[1][:, 0]
    return np.asarray(h if h @ start > 0.0 else -h)


def _estimate(
    h: FloatArray, rows: Forms, current: FloatArray, desired: FloatArray, noise: float
) -> Estimate:
    distance = np.sqrt(squared_distances(h[None], rows)[0])
    sides = (h[:2] @ rows.sides_a) * (h[2:] @ rows.sides_d)
    inliers = (distance <= INLIER_DEVIATIONS * noise) & (sides < 0.0)
    bearings = Bearings(math.atan2(h[1], h[0]), math.atan2(h[3], h[2]))
    vote = cheirality(bearings, current[inliers], desired[inliers], noise=noise)
    p0, p1, q0, q1 = h if vote.bearings == bearings else -h
    fundamental = np.array([[0.0, -p1, 0.0], [q0, 0.0, q1], [0.0, p0, 0.0]])
    return Estimate(
        vote.bearings, fundamental, inliers, vote.confidence, _covariance(h, rows, noise)
    )


def _covariance(h: FloatArray, rows: Forms, noise: float) -> FloatArray:
    """Return the covariance of (psi, phi), shape (2, 2) [rad^2]."""
    squared = squared_distances(h[None], rows)[0]
    gradient = np.maximum((h @ rows.linear) ** 2 / np.maximum(squared, 1e-300), 1e-12)
    information = (rows.linear * (tukey(np.sqrt(squared), noise) / gradient)) @ rows.linear.T
    covariance = noise**2 * np.linalg.pinv(information, rcond=1e-9, hermitian=True)
    norm_p, norm_q = h[:2] @ h[:2], h[2:] @ h[2:]
    to_angles = np.array(
        [[-h[1] / norm_p, h[0] / norm_p, 0.0, 0.0], [0.0, 0.0, -h[3] / norm_q, h[2] / norm_q]]
    )
    return np.asarray(to_angles @ covariance @ to_angles.T)
