"""The paper's estimator: Hartley's normalised 8-point algorithm inside least median of squares."""

import math

import numpy as np

from visual_servo_epipolar.core.arrays import BoolArray, FloatArray, NORMAL
from visual_servo_epipolar.core.errors import DegenerateGeometryError
from visual_servo_epipolar.core.estimators.base import Estimate, Prior, UNKNOWN_COVARIANCE
from visual_servo_epipolar.core.estimators.machinery.eight_point import (
    design_matrix,
    fundamental_from_matches,
    hartley_normalisation,
    MIN_MATCHES,
    transform,
)
from visual_servo_epipolar.core.estimators.machinery.hypotheses import rays_of
from visual_servo_epipolar.core.geometry.cheirality import oriented_bearings
from visual_servo_epipolar.core.geometry.epipolar import image_sampson_distance
from visual_servo_epipolar.core.geometry.rays import image_points

SUBSETS = 560  # one of 26 matches is clean with probability 99 % at 40 % outliers
INLIER_DEVIATIONS = 2.5
LEAST_FORWARD = 0.1  # z of a ray that has an image-plane point: 84 deg off the axis


def lmeds_8pt(
    current: FloatArray,
    desired: FloatArray,
    *,
    noise: FloatArray | float,
    rng: np.random.Generator,
    prior: Prior | None = None,
) -> Estimate:
    """
    Estimate F by LMedS over minimal subsets, then by all inliers (section VIII of the paper).

    As in the paper, image-plane points are what is fitted, with Hartley's normalisation: only
    features well in front of both cameras have them, others are no inliers.

    Parameters
    ----------
    current, desired : arrays, shape (N, 3)
        Matches as unit rays, at least eight of them in front.
    noise : float or array, shape (N, 2)
        Deviations of the angles of rays [rad]; only the cheirality vote uses them.
    rng : Generator
        Draws the subsets.
    prior : Prior, optional
        Not used: the paper has none.

    Raises
    ------
    DegenerateGeometryError
        With fewer than eight matches in front, or fewer than eight inliers.

    """
    del prior
    front = np.minimum(current[:, 2], desired[:, 2]) > LEAST_FORWARD
    points_a, points_d = image_points(current[front]), image_points(desired[front])
    if len(points_a) < MIN_MATCHES:
        raise DegenerateGeometryError(
            f'LMedS needs at least {MIN_MATCHES} matches, got {len(points_a)}; track more features'
        )
    candidates = _minimal_solutions(points_a, points_d, rng)
    squared = image_sampson_distance(candidates, points_a, points_d) ** 2
    medians = np.median(squared, axis=-1)
    best = int(np.argmin(medians))
    agree = _inliers(squared[best], float(medians[best]))
    fundamental = fundamental_from_matches(points_a[agree], points_d[agree])
    inliers = front.copy()
    inliers[front] = agree
    deviations = rays_of(current, desired, noise).noise
    vote = oriented_bearings(
        fundamental, current[inliers], desired[inliers], noise=deviations[inliers]
    )
    return Estimate(vote.bearings, fundamental, inliers, vote.confidence, UNKNOWN_COVARIANCE)


def _minimal_solutions(
    current: FloatArray, desired: FloatArray, rng: np.random.Generator
) -> FloatArray:
    """Return one F for each subset of eight matches, shape (SUBSETS, 3, 3)."""
    to_current, to_desired = hartley_normalisation(current), hartley_normalisation(desired)
    rows = design_matrix(transform(to_current, current), transform(to_desired, desired))
    picks = np.argsort(rng.random((SUBSETS, len(current))), axis=1)[:, :MIN_MATCHES]
    subsets = rows[picks]  # (SUBSETS, 8, 9)
    gram = np.swapaxes(subsets, 1, 2) @ subsets
    solutions = np.linalg.eigh(gram)[1][:, :, 0].reshape(-1, 3, 3)
    u, singular, vt = np.linalg.svd(solutions)
    singular[:, 2] = 0.0
    return np.asarray(to_desired.T @ ((u * singular[:, None, :]) @ vt) @ to_current)


def _inliers(squared: FloatArray, median: float) -> BoolArray:
    """Return the matches within 2.5 robust standard deviations (Rousseeuw and Leroy 1987)."""
    spare = max(len(squared) - MIN_MATCHES, 1)
    deviation = NORMAL * (1.0 + 5.0 / spare) * math.sqrt(median)
    inliers = squared <= (INLIER_DEVIATIONS * deviation) ** 2
    if int(inliers.sum()) < MIN_MATCHES:
        inliers = squared <= np.sort(squared)[MIN_MATCHES - 1]
    return np.asarray(inliers)
