"""Three degrees of freedom: planar motion, upright camera, focal length unknown."""

import numpy as np

from visual_servo_epipolar.core.arrays import BoolArray, ComplexArray, FloatArray
from visual_servo_epipolar.core.estimators.base import Estimate, Prior
from visual_servo_epipolar.core.estimators.machinery.hypotheses import (
    FAMILIES,
    fused,
    INLIER_DEVIATIONS,
    modes,
    plausible,
    Rays,
    rays_of,
    TINY,
    too_few,
    undetermined,
)
from visual_servo_epipolar.core.estimators.machinery.refinement import (
    Belief,
    Fit,
    NEGLIGIBLE,
    problem,
    refined,
)
from visual_servo_epipolar.core.estimators.machinery.sampson import squared_distances, table_of
from visual_servo_epipolar.core.geometry.cheirality import cheirality
from visual_servo_epipolar.core.geometry.epipolar import Bearings

MIN_MATCHES = 4
TRIPLES = 400
MODES = 3
PSI, PHI, RATIO = range(3)  # the last is log(|q| / |p|)
LARGEST_RATIO = 3.0
BELIEF = Belief(np.zeros(3), np.zeros(3))  # nothing is known beforehand
UNKNOWN = np.full((1, 2), np.nan)


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
        With fewer than four matches, or all of them on the horizon, or no baseline at all.

    """
    del prior
    rays = rays_of(current, desired)
    kept = plausible(rays, INLIER_DEVIATIONS * noise)
    rays = Rays(*(coordinate[kept] for coordinate in rays))
    if len(rays.u_a) < MIN_MATCHES:
        raise too_few(len(rays.u_a), len(kept), MIN_MATCHES)
    table = table_of(rays, noise)
    hypotheses = _three_point_hypotheses(rays, rng)
    start = _best(hypotheses, table)
    found = refined(start, problem(_model, table, BELIEF), negligible=NEGLIGIBLE * noise)
    inliers = kept.copy()
    best = int(found.costs.argmin())
    inliers[kept] = found.squared[best] <= INLIER_DEVIATIONS**2
    return _estimate(found, best, current, desired, inliers, noise)


def _three_point_hypotheses(rays: Rays, rng: np.random.Generator) -> FloatArray:
    """Return the null vector of three rows of the constraint each, shape (H, 4), by cofactors."""
    u_a, v_a, u_d, v_d = rays
    rows = np.stack([v_a, -v_a * u_d, v_d * u_a, v_d], axis=1)
    picks = np.argsort(rng.random((TRIPLES, len(u_a))), axis=1)[:, :3]
    a, b, c = (rows[picks[:, k]] for k in range(3))
    found = np.empty((TRIPLES, 4))
    for k in range(4):
        x, y, z = (column for column in range(4) if column != k)
        found[:, k] = (-1.0) ** k * (
            a[:, x] * (b[:, y] * c[:, z] - b[:, z] * c[:, y])
            - a[:, y] * (b[:, x] * c[:, z] - b[:, z] * c[:, x])
            + a[:, z] * (b[:, x] * c[:, y] - b[:, y] * c[:, x])
        )
    return found


def _best(hypotheses: FloatArray, table: FloatArray) -> FloatArray:
    """Return psi, phi and ratio of the best hypotheses of different modes, shape (K, 3)."""
    numbers: ComplexArray = hypotheses.view(np.complex128) + TINY
    size = np.abs(numbers)
    ratio = np.log(size[:, 1]) - np.log(size[:, 0])
    ratio = np.minimum(np.maximum(ratio, -LARGEST_RATIO), LARGEST_RATIO)
    numbers = numbers / size
    parameters = np.column_stack([np.angle(numbers), ratio])
    squared = squared_distances(_model(parameters)[:, 0], table)
    costs = np.minimum(squared / INLIER_DEVIATIONS**2, 1.0).mean(axis=1)
    return np.asarray(parameters[modes(numbers.T, costs, MODES)])


def _model(parameters: FloatArray) -> FloatArray:
    """Return E and its derivatives by psi, phi and ratio, shape (K, 4, 9)."""
    parts = np.exp(1j * parameters[:, :RATIO]).view(np.float64)
    parts[:, 2:] *= np.exp(parameters[:, RATIO:])
    made = (parts @ FAMILIES).reshape(-1, 3, 9)
    by_ratio = parts[:, 2:] @ FAMILIES[2:, :9]
    return np.concatenate([made, by_ratio[:, None]], axis=1)


def _estimate(
    found: Fit,
    best: int,
    current: FloatArray,
    desired: FloatArray,
    inliers: BoolArray,
    noise: float,
) -> Estimate:
    covariance = found.covariance()[best]
    parameters, (determined,) = fused(
        found.parameters[best : best + 1], covariance[None], UNKNOWN, np.ones(1)
    )
    if not determined:
        raise undetermined()
    parameters = parameters[0]
    bearings = Bearings(float(parameters[PSI]), float(parameters[PHI]))
    vote = cheirality(bearings, current[inliers], desired[inliers], noise=noise)
    fundamental = _model(parameters[None])[0, 0].reshape(3, 3)
    return Estimate(
        vote.bearings,
        fundamental if vote.bearings == bearings else -fundamental,
        inliers,
        vote.confidence,
        covariance[: PHI + 1, : PHI + 1],
    )
