"""Three degrees of freedom: planar motion, upright camera, focal length unknown."""

import numpy as np

from visual_servo_epipolar.core.arrays import ComplexArray, FloatArray, packed, TINY
from visual_servo_epipolar.core.geometry.cheirality import cheirality
from visual_servo_epipolar.core.geometry.epipolar import Bearings
from visual_servo_epipolar.core.geometry.least_squares import samples
from visual_servo_epipolar.core.twoview.estimator import Estimate, Prior
from visual_servo_epipolar.core.twoview.hypotheses import (
    best_modes,
    FAMILIES,
    INLIER_DEVIATIONS,
    plausible,
    Rays,
    rays_of,
    remaining_rays,
)
from visual_servo_epipolar.core.twoview.planar import require_determined
from visual_servo_epipolar.core.twoview.refinement import (
    GaussianPrior,
    problem_of,
    refined,
    truncated_costs,
)

MIN_MATCHES = 4
TRIPLES = 400
MODES = 3
PHI, RATIO = 1, 2  # places after psi; the last is log(|q| / |p|)
LARGEST_RATIO = 3.0
NO_PRIOR = GaussianPrior(np.zeros(3), np.zeros((3, 3)))


def planar_3dof(
    current: FloatArray,
    desired: FloatArray,
    *,
    noise: FloatArray | float,
    prior: Prior,
    rng: np.random.Generator,
) -> Estimate:
    """
    Estimate h = (p0, p1, q0, q1) up to scale, with |q| / |p| free, from triples of matches.

    A wrong focal length scales x and y alike and is absorbed by |q| / |p|: the epipoles in pixels
    stay right, though the bearings are those of the wrong camera. On a vertical plane every such
    geometry fits, so that scenes of one wall need a known focal length. ``rng`` draws the triples.

    Raises
    ------
    DegenerateGeometryError
        With fewer than four matches, or all of them on the horizon, or no baseline at all.

    """
    del prior
    rays = rays_of(current, desired, noise)
    matches = plausible(rays, INLIER_DEVIATIONS * rays.noise)
    remaining = remaining_rays(rays, matches, MIN_MATCHES)
    problem = problem_of(_model, NO_PRIOR, remaining)
    starts = _best(_three_point_hypotheses(remaining, rng), problem.table)
    fits = refined(starts, problem)
    fit = fits.take(int(fits.costs.argmin())).of_all(matches)
    covariance = fit.covariance()
    require_determined(covariance)
    psi, phi, _ = fit.parameters.tolist()
    bearings, inliers = Bearings(psi, phi), fit.squared <= INLIER_DEVIATIONS**2
    vote = cheirality(bearings, current[inliers], desired[inliers], noise=rays.noise[inliers])
    sign = 1.0 if vote.bearings == bearings else -1.0
    return Estimate(
        vote.bearings,
        sign * _model(fit.parameters)[0].reshape(3, 3),
        inliers,
        vote.confidence,
        covariance[: PHI + 1, : PHI + 1],
    )


def _three_point_hypotheses(rays: Rays, rng: np.random.Generator) -> FloatArray:
    """Return the null vector of three rows of the constraint each, shape (H, 4), by cofactors."""
    x_a, y_a, z_a, x_d, y_d, z_d, _, _ = rays
    rows = np.stack([y_a * z_d, -y_a * x_d, y_d * x_a, y_d * z_a], axis=1)
    picks = samples(rng, TRIPLES, rays.matches, 3)
    a, b, c = (rows[picks[:, k]] for k in range(3))
    null_vectors = np.empty((TRIPLES, 4))
    for k in range(4):
        x, y, z = (column for column in range(4) if column != k)
        null_vectors[:, k] = (-1.0) ** k * (
            a[:, x] * (b[:, y] * c[:, z] - b[:, z] * c[:, y])
            - a[:, y] * (b[:, x] * c[:, z] - b[:, z] * c[:, x])
            + a[:, z] * (b[:, x] * c[:, y] - b[:, y] * c[:, x])
        )
    return null_vectors


def _best(hypotheses: FloatArray, table: FloatArray) -> FloatArray:
    """Return psi, phi and ratio of the best hypotheses of different modes, shape (K, 3)."""
    pairs: ComplexArray = hypotheses.view(np.complex128) + TINY
    size = np.abs(pairs)
    ratio = np.log(packed(size[:, 1])) - np.log(packed(size[:, 0]))
    ratio = np.minimum(np.maximum(ratio, -LARGEST_RATIO), LARGEST_RATIO)
    phasors = pairs / size
    parameters = np.column_stack([np.angle(phasors), ratio])
    costs = truncated_costs(_model(parameters)[:, 0], table)
    return np.asarray(parameters[best_modes(phasors.T, costs, MODES)])


def _model(parameters: FloatArray) -> FloatArray:
    """Return E and its derivatives by psi, phi and ratio, shape (..., 3), as rows: (..., 4, 9)."""
    parts = np.exp(1j * parameters[..., :RATIO]).view(np.float64)
    parts[..., 2:] *= np.exp(packed(parameters[..., RATIO:]))
    by_angles = (parts @ FAMILIES).reshape(*parameters.shape[:-1], 3, 9)
    by_ratio = parts[..., 2:] @ FAMILIES[2:, :9]
    return np.concatenate([by_angles, by_ratio[..., None, :]], axis=-2)
