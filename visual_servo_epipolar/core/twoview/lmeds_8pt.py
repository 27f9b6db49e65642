"""The paper's estimator: Hartley's normalised 8-point algorithm inside least median of squares."""

import math

import numpy as np

from visual_servo_epipolar.core.arrays import as_points, BoolArray, FloatArray
from visual_servo_epipolar.core.errors import DegenerateGeometryError
from visual_servo_epipolar.core.geometry.cheirality import oriented_bearings
from visual_servo_epipolar.core.geometry.epipolar import (
    constraint_rows,
    MIN_MATCHES,
    rank_two,
    sampson_distance,
)
from visual_servo_epipolar.core.geometry.least_squares import deviation_of, null_vector, samples
from visual_servo_epipolar.core.geometry.rays import image_points, LEAST_FORWARD
from visual_servo_epipolar.core.twoview.estimator import Estimate, Prior, UNKNOWN_COVARIANCE
from visual_servo_epipolar.core.twoview.hypotheses import INLIER_DEVIATIONS, rays_of

SUBSETS = 560  # one of 26 matches is clean with probability 99 % at 40 % outliers


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
    features well in front of both cameras have them, others are no inliers. Matches are unit rays,
    (N, 3); ``noise`` serves the cheirality vote alone, ``rng`` draws the subsets, and the paper
    has no ``prior``.

    Raises DegenerateGeometryError with fewer than eight matches in front, or eight inliers.
    """
    del prior
    front = np.minimum(current[:, 2], desired[:, 2]) > LEAST_FORWARD
    points_a, points_d = image_points(current[front]), image_points(desired[front])
    if len(points_a) < MIN_MATCHES:
        raise DegenerateGeometryError(
            f'LMedS needs at least {MIN_MATCHES} matches, got {len(points_a)}; track more features'
        )
    candidates = _minimal_solutions(points_a, points_d, rng)
    squared = sampson_distance(candidates, points_a, points_d) ** 2
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
    rows = constraint_rows(transform(to_current, current), transform(to_desired, desired))
    subsets = rows[samples(rng, SUBSETS, len(current), MIN_MATCHES)]  # (SUBSETS, 8, 9)
    solutions = null_vector(subsets).reshape(-1, 3, 3)
    return np.asarray(to_desired.T @ rank_two(solutions) @ to_current)


def _inliers(squared: FloatArray, median: float) -> BoolArray:
    """Return the matches within 2.5 robust standard deviations."""
    deviation = deviation_of(math.sqrt(median), len(squared) - MIN_MATCHES)
    inliers = squared <= (INLIER_DEVIATIONS * deviation) ** 2
    if int(inliers.sum()) < MIN_MATCHES:
        inliers = squared <= np.sort(squared)[MIN_MATCHES - 1]
    return np.asarray(inliers)


def hartley_normalisation(points: FloatArray) -> FloatArray:
    """Return T, shape (3, 3): centroid to the origin, mean distance to sqrt(2) (Hartley 1995)."""
    centre = points.mean(axis=0)
    spread = float(np.sqrt(((points - centre) ** 2).sum(axis=1)).mean())
    if not spread > 0.0:
        raise DegenerateGeometryError(
            f'{len(points)} points coincide at {centre}; track features spread over the image'
        )
    scale = math.sqrt(2.0) / spread
    return np.array(
        [[scale, 0.0, -scale * centre[0]], [0.0, scale, -scale * centre[1]], [0.0, 0.0, 1.0]]
    )


def fundamental_from_matches(current: FloatArray, desired: FloatArray) -> FloatArray:
    """
    Return F of rank 2 by the normalised 8-point algorithm, shape (3, 3), Frobenius norm 1.

    Matches, (N, 2), are in pixels or (x/z, y/z), and F is for the same unit. Raises
    DegenerateGeometryError with fewer than eight, or where points coincide.
    """
    current, desired = as_points(current, 'current'), as_points(desired, 'desired')
    if len(current) != len(desired) or len(current) < MIN_MATCHES:
        raise DegenerateGeometryError(
            f'the 8-point algorithm needs at least {MIN_MATCHES} matches, got {len(current)} '
            f'current and {len(desired)} desired points; track more features'
        )
    to_current, to_desired = hartley_normalisation(current), hartley_normalisation(desired)
    rows = constraint_rows(transform(to_current, current), transform(to_desired, desired))
    solution = np.linalg.svd(rows, full_matrices=True)[2][-1].reshape(3, 3)
    fundamental = to_desired.T @ rank_two(solution) @ to_current
    return np.asarray(fundamental / np.linalg.norm(fundamental))


def transform(matrix: FloatArray, points: FloatArray) -> FloatArray:
    """Return affine ``matrix``, shape (3, 3), applied to ``points``, shape (N, 2)."""
    return np.asarray(points @ matrix[:2, :2].T + matrix[:2, 2])
