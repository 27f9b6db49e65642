"""
Fitting: the pose of one view on the structure, by features as if independent of each other.

A few steps, each with the features' own covariance; ``resection`` takes the last one. What is
known of features is the same for all views of them, and looked up once.
"""

from dataclasses import dataclass, field
from functools import cached_property
from typing import NamedTuple

import numpy as np

from visual_servo_epipolar.core.arrays import BoolArray, FloatArray, IntArray, median
from visual_servo_epipolar.core.geometry.least_squares import (
    Equations,
    least_squares,
    USUAL_SQUARES,
)
from visual_servo_epipolar.core.mapping.adjustment.equations import OUTLIER, robust_weight
from visual_servo_epipolar.core.mapping.adjustment.projection import (
    BY_FEATURE,
    BY_VIEW,
    is_ahead,
    OPPOSITE,
    project,
    Projection,
    slopes,
    squares_of,
    Structure,
)
from visual_servo_epipolar.core.mapping.adjustment.refinement import Geometry
from visual_servo_epipolar.core.mapping.adjustment.window import (
    HEADING,
    MOUNT,
    SHARED,
    TILT,
    VIEW,
)

STEPS = 8
LEAST_STEP = 0.1  # squared, in deviations, below which the last step does the rest
FAR = 1e3  # squared, likewise, from which slopes are taken anew
NEAR = 1e2  # squared, likewise, up to which slopes are those of the last step as well
RIDGE = 1e-6  # information of what no feature shows [1/m^2]
EVERY = VIEW + 1  # element of a matrix, (5, 5), is one of its diagonal


@dataclass(frozen=True, eq=False)
class MatchedFeatures:
    """What a view shows of features of the map: ``rows``, (n,), of the structure."""

    rows: IntArray
    rays: FloatArray  # (3, n)
    tangent_basis: FloatArray  # (2, 3, n)


@dataclass(frozen=True, eq=False)
class Anchors:
    """Features of a ``structure``, their ``covariance``, (3, 3, n), and the attitude, (2,)."""

    structure: Structure
    covariance: FloatArray
    attitude: FloatArray
    deviation: FloatArray

    def of(self, rows: IntArray) -> 'Anchors':
        """Return the anchors of these features alone."""
        rays, by_unknowns, inverse_depth, stretch = self.structure
        structure = Structure(rays[:, rows], by_unknowns[..., rows], inverse_depth[rows], stretch)
        covariance = self.covariance[..., rows]
        return Anchors(structure, covariance, self.attitude, self.deviation)

    @cached_property
    def known(self) -> tuple[FloatArray, FloatArray]:
        """Information of tilt and roll, (2,), and of all unknowns of a view, (5,)."""
        information = self.deviation**-2
        return information, np.concatenate([np.zeros(TILT), information]) + RIDGE


class PoseFit(NamedTuple):
    """Pose, (5,), squared residuals, (n,), their widening; ``slopes``, (11, 2, n), if near."""

    pose: FloatArray
    squares: FloatArray
    widening: float
    slopes: FloatArray | None = None

    @property
    def inliers(self) -> BoolArray:
        """Which features agree."""
        return np.asarray(self.squares <= OUTLIER)


def anchors_of(geometry: Geometry) -> Anchors:
    """Return the features of a refined window as anchors."""
    jitter = geometry.evaluation.factors.jitter
    attitude_variance = (geometry.root[-2:] ** 2).sum(1)
    return Anchors(
        geometry.evaluation.structure,
        geometry.feature_covariance,
        geometry.unknowns.shared[MOUNT],
        np.sqrt(jitter * jitter + attitude_variance),
    )


class FeatureErrors(NamedTuple):
    """
    Errors of n features: ``own`` roots, (n, 3, 3), and what r errors of keyframes make.

    Those are ``shared``, (n, 6, r), of the unknowns of a feature and of the photograph, and
    ``attitude``, (2, r), of the mount's, in deviations of what the floor does. ``offsets``,
    (2, 1, n), are those that keyframes gave the photograph's rays, in deviations.
    """

    own: FloatArray
    shared: FloatArray
    attitude: FloatArray
    offsets: FloatArray


def errors_of(geometry: Geometry, rows: IntArray) -> FeatureErrors:
    """Return the errors of the features in ``rows``, (n,), of a geometry."""
    covariance_root, count = geometry.covariance_root, len(rows)
    shared = np.empty((count, 6, covariance_root.shape[1]))
    shared[:, :3], shared[:, 3:] = (
        geometry.feature_covariance_root[rows],
        covariance_root[-SHARED:-2],
    )
    jitter = geometry.evaluation.factors.jitter
    return FeatureErrors(
        geometry.system.roots[rows],
        shared,
        covariance_root[-2:] / jitter,
        geometry.unknowns.offsets[:, None, rows],
    )


@dataclass(frozen=True, eq=False)
class Correspondences:
    """
    Correspondences of a view of features ``ids``, (N,), with a ``geometry``.

    ``rows``, (N,), of the features there, -1 for others; ``known``, (N,), says which are trusted
    and have a place. Of those, n, are ``chosen`` rows, (n,), ``anchors`` and ``errors``;
    ``everything`` are the anchors of all features of the geometry. ``slopes`` of D [1/m] are those
    that readings of such views asked for, by the number of features that the photograph shows, and
    whether the lens is wide.
    """

    geometry: Geometry
    ids: IntArray
    rows: IntArray
    known: BoolArray
    chosen: IntArray
    everything: Anchors
    anchors: Anchors
    errors: FeatureErrors
    slopes: dict[tuple[int, bool], float] = field(default_factory=dict)

    def are_of(self, geometry: Geometry, ids: IntArray) -> bool:
        """Return whether they are those of a view of features ``ids``, (N,)."""
        alike = geometry is self.geometry and len(ids) == len(self.ids)
        return alike and bool((ids == self.ids).all())


def correspondences_of(geometry: Geometry, ids: IntArray) -> Correspondences:
    """Return the correspondences of a view of features ``ids``, (N,)."""
    rows = geometry.window.rows_of(ids)
    known = rows >= 0
    known[known] = geometry.trusted[rows[known]]
    chosen, everything = rows[known], anchors_of(geometry)
    return Correspondences(
        geometry,
        ids,
        rows,
        known,
        chosen,
        everything,
        everything.of(chosen),
        errors_of(geometry, chosen),
    )


class _Slopes(NamedTuple):
    """Slopes of residuals by the view, (5, 2, n), and what those tell, at some pose."""

    every: FloatArray  # by all unknowns, (11, 2, n)
    own: FloatArray
    information: FloatArray  # inverted covariances of residuals, (2, 2, n)
    weighted: FloatArray  # slopes times those


def _slopes(
    anchors: Anchors, seen: MatchedFeatures, pose: FloatArray, projection: Projection
) -> _Slopes:
    found = slopes(anchors.structure, pose, seen.tangent_basis, projection)
    information = _information(found[BY_FEATURE], anchors.covariance)
    weighted = _times(information, found[BY_VIEW])
    return _Slopes(found, found[BY_VIEW], information, weighted)


class _Step(NamedTuple):
    """Squared residuals, (n,), at some pose, their widening, and equations of the next."""

    equations: Equations
    squares: FloatArray
    widening: float

    def change(self) -> FloatArray:
        return self.equations.change()


def fit_pose(anchors: Anchors, seen: MatchedFeatures, start: FloatArray) -> PoseFit:
    """Return the pose that fits best, from ``start``, (5,), by features as if independent."""
    at: _Slopes | None = None
    farthest = 0.0  # since slopes were taken
    known, ridge = anchors.known

    def linearise(pose: FloatArray, number: int) -> _Step:
        nonlocal at, farthest
        projection = project(anchors.structure, pose, seen.tangent_basis)
        residuals = projection.residuals
        if at is None:
            at, farthest = _slopes(anchors, seen, pose, projection), 0.0
        products = _times(at.information, residuals)
        products *= residuals
        squares = np.where(is_ahead(projection, seen.rays), products[0] + products[1], OPPOSITE)
        widening = max(1.0, median(squares) / USUAL_SQUARES)
        weight = robust_weight(squares if widening == 1.0 else squares / widening)
        rows = (at.weighted * weight).reshape(VIEW, -1)
        matrix = rows @ at.own.reshape(VIEW, -1).T
        matrix.ravel()[::EVERY] += ridge
        vector = rows @ residuals.ravel()
        vector[TILT:] += known * (pose[TILT:] - anchors.attitude)
        return _Step(Equations(matrix, vector), squares, widening)

    def moved(pose: FloatArray, step: _Step, change: FloatArray) -> tuple[FloatArray, bool]:
        nonlocal at, farthest
        way = float(change @ step.equations.pull)
        farthest, last = max(farthest, way), way < LEAST_STEP * step.widening
        at = at if last or way < FAR else None
        return pose - change, last

    pose, step = least_squares(start, linearise, moved, STEPS)
    every = at.every if at is not None and farthest < NEAR else None
    return PoseFit(pose, step.squares, step.widening, every)


def _information(own: FloatArray, covariance: FloatArray) -> FloatArray:
    """Return inverted covariances, (2, 2, n), of residuals with slopes ``own``, (3, 2, n)."""
    turned = np.add.reduce(covariance[:, :, None] * own, axis=1)  # (3, 2, n)
    # Of the first residual with both, and of the other with itself.
    first, c = np.add.reduce(own[:, :1] * turned, axis=0), own[:, 1] * turned[:, 1]
    a, b, c = first[0] + 1.0, first[1], np.add.reduce(c, axis=0) + 1.0
    determinant = a * c - b * b
    inverse = np.empty((2, 2, own.shape[-1]))
    np.divide(c, determinant, out=inverse[0, 0])
    np.divide(a, determinant, out=inverse[1, 1])
    np.divide(-b, determinant, out=inverse[0, 1])
    inverse[1, 0] = inverse[0, 1]
    return inverse


def _times(matrices: FloatArray, vectors: FloatArray) -> FloatArray:
    """Return matrices, (2, 2, n), times vectors, (..., 2, n)."""
    product = matrices[0] * vectors[..., :1, :]  # they are symmetric
    product += matrices[1] * vectors[..., 1:, :]
    return np.asarray(product)


def fit_pose_near(
    views: FloatArray, anchors: Anchors, seen: MatchedFeatures, last: FloatArray | None
) -> PoseFit:
    """Return the pose by the ``last`` one, or by the most alike of ``views``, (K, 5)."""
    fit = fit_pose(anchors, seen, views[-1] if last is None else last)
    if 2 * int(fit.inliers.sum()) > len(seen.rows):
        return fit
    again = fit_pose(anchors, seen, nearest_view(anchors, seen, views))
    return again if again.inliers.sum() > fit.inliers.sum() else fit


def nearest_view(anchors: Anchors, seen: MatchedFeatures, views: FloatArray) -> FloatArray:
    """Return of ``views``, (K, 5), the one most alike, turned to fit: a start after a push."""
    bearing = np.arctan2(seen.rays[0], seen.rays[2])
    tangent_basis = np.broadcast_to(seen.tangent_basis, (len(views), *seen.tangent_basis.shape))
    points = project(anchors.structure, views, tangent_basis).points
    off = bearing - np.arctan2(points[:, 0], points[:, 2])
    off = np.sort(np.remainder(off + np.pi, 2.0 * np.pi) - np.pi, axis=1)
    turned = views.copy()
    turned[:, HEADING] += off[:, off.shape[1] // 2]  # a left turn moves the image right
    again = project(anchors.structure, turned, tangent_basis)
    squares = np.sort(squares_of(again, np.broadcast_to(seen.rays, again.points.shape)), axis=1)
    return np.asarray(turned[int(squares[:, squares.shape[1] // 2].argmin())])


def pose_covariance(anchors: Anchors, seen: MatchedFeatures, fit: PoseFit) -> FloatArray:
    """Return the covariance of a fitted pose, (5, 5), by features as if independent."""
    projection = project(anchors.structure, fit.pose, seen.tangent_basis)
    at = _slopes(anchors, seen, fit.pose, projection)
    weight = robust_weight(fit.squares / fit.widening) / fit.widening
    rows = (at.weighted * weight).reshape(VIEW, -1)
    matrix = rows @ at.own.reshape(VIEW, -1).T
    matrix.ravel()[::EVERY] += anchors.known[1]
    return np.asarray(np.linalg.inv(matrix))
