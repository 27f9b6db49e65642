"""
Fitting: the pose of one view on the structure, by features as if independent of each other.

A few steps, each with the features' own covariance; resection takes the last one, with that of
the whole structure: what features share (errors of keyframes) does not average out over them.
"""

from dataclasses import dataclass
from functools import cached_property
import math
from typing import NamedTuple

import numpy as np

from visual_servo_epipolar.core.arrays import BoolArray, FloatArray, IntArray, median
from visual_servo_epipolar.core.geometry.least_squares import (
    Equations,
    least_squares,
    USUAL_SQUARES,
)
from visual_servo_epipolar.core.mapping.factors import LEAST_PLACE
from visual_servo_epipolar.core.mapping.localization import MapLocalization
from visual_servo_epipolar.core.mapping.projection import (
    BY_FEATURE,
    BY_VIEW,
    is_ahead,
    OFFSETS,
    OPPOSITE,
    project,
    slopes,
    squares_of,
    Structure,
)
from visual_servo_epipolar.core.mapping.refinement import (
    Geometry,
    OUTLIER,
    robust_weight,
)
from visual_servo_epipolar.core.mapping.window import (
    HEADING,
    MOUNT,
    SHARED,
    TILT,
    VIEW,
)

STEPS = 8
LEAST_STEP = 0.1  # squared, in deviations, below which the last step does the rest


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
        return information, np.concatenate([np.zeros(TILT), information]) + LEAST_PLACE


class PoseFit(NamedTuple):
    """Pose, (5,), squared residuals, (n,), and their widening."""

    pose: FloatArray
    squares: FloatArray
    widening: float

    @property
    def inliers(self) -> BoolArray:
        """Which features agree."""
        return np.asarray(self.squares <= OUTLIER)

    @property
    def spread(self) -> float:
        """How many times as large squares are as expected, of all but outliers, at least once."""
        usual = self.squares[self.squares <= OUTLIER * self.widening]
        return max(1.0, median(usual) / USUAL_SQUARES) if len(usual) else self.widening


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


class _Step(NamedTuple):
    """Squared residuals, (n,), at some pose, their widening, and equations of the next."""

    equations: Equations
    squares: FloatArray
    widening: float

    def change(self) -> FloatArray:
        return self.equations.change()


def _linearised(
    anchors: Anchors, seen: MatchedFeatures, pose: FloatArray, weight: FloatArray | None = None
) -> _Step:
    """Return the equations of a view at a ``pose``, by a ``weight``, (n,), or by its residuals."""
    projection = project(anchors.structure, pose, seen.tangent_basis)
    found = slopes(anchors.structure, pose, seen.tangent_basis, projection)
    by_feature = found[BY_FEATURE].transpose(2, 1, 0)
    blocks = by_feature @ anchors.covariance.transpose(2, 0, 1) @ by_feature.swapaxes(1, 2)
    # Inverted covariances of residuals, (2, 2, n).
    information = np.asarray(np.linalg.inv(np.eye(2) + blocks).transpose(1, 2, 0))
    squares = _times(information, projection.residuals) * projection.residuals
    squares = np.where(is_ahead(projection, seen.rays), np.add.reduce(squares, axis=0), OPPOSITE)
    widening = max(1.0, median(squares) / USUAL_SQUARES)
    weight = robust_weight(squares / widening) if weight is None else weight
    rows = (_times(information, found[BY_VIEW]) * weight).reshape(VIEW, -1)
    known, prior = anchors.known
    matrix = rows @ found[BY_VIEW].reshape(VIEW, -1).T + np.diag(prior)
    pull = rows @ projection.residuals.ravel()
    pull[TILT:] += known * (pose[TILT:] - anchors.attitude)
    return _Step(Equations(matrix, pull), squares, widening)


def fit_pose(anchors: Anchors, seen: MatchedFeatures, start: FloatArray) -> PoseFit:
    """Return the pose that fits best, from ``start``, (5,), by features as if independent."""

    def linearise(pose: FloatArray, number: int) -> _Step:
        return _linearised(anchors, seen, pose)

    def moved(pose: FloatArray, step: _Step, change: FloatArray) -> tuple[FloatArray, bool]:
        way = float(change @ step.equations.pull)
        return pose - change, way < LEAST_STEP * step.widening

    pose, step = least_squares(start, linearise, moved, STEPS)
    return PoseFit(pose, step.squares, step.widening)


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
    weight = robust_weight(fit.squares / fit.widening) / fit.widening
    equations = _linearised(anchors, seen, fit.pose, weight).equations
    return np.asarray(np.linalg.inv(equations.information))


ALIKE = 0.05  # of the depth: how near the goal views look as the photograph does
DRIFT = 0.04  # of the share, from view to view: what looks alike changes with the distance
# Shares up to which nothing, and from which all is withdrawn: noise alone makes some hundredths,
# and what features have in common, which displaces most, shows least in what they disagree on.
CHANCE, ALL = 0.2, 0.5
LEAST_VARIANCE = 1e-6


@dataclass(frozen=True, slots=True)
class Shrinkage:
    """
    The ``share`` of the keyframes' corrections that views do not confirm, and its ``variance``.

    Keyframes correct the rays of the photograph, whose noise they average. What a tracker gets
    wrong, though, is not noise: from afar a patch looks another, and is aligned with an error that
    is about the same in all views, while near the goal, where the image is that of the photograph,
    there is none. So a view near the goal tells by which share the corrections are to be
    withdrawn: by hardly any where there is noise alone.
    """

    share: float = 0.0
    variance: float = LEAST_VARIANCE

    @property
    def withdrawn(self) -> float:
        """Return the share that is withdrawn, from 0 to 1."""
        return min(max((self.share - CHANCE) / (ALL - CHANCE), 0.0), 1.0)

    def before(self, distance: float, depth: float) -> 'Shrinkage':
        """Return what is known before the next view, at a ``distance`` from the goal [m]."""
        if not distance < ALIKE * depth:
            return NOTHING
        return Shrinkage(self.share, min(self.variance + DRIFT * DRIFT, 1.0))


NOTHING = Shrinkage()


def resect(
    geometry: Geometry,
    anchors: Anchors,
    seen: MatchedFeatures,
    fit: PoseFit,
    shrinkage: Shrinkage,
) -> tuple[MapLocalization, Shrinkage]:
    """
    Return where a view is, after one step with the whole structure's errors.

    And the shrinkage of the photograph's corrections, with what this view tells of it.
    """
    projection = project(anchors.structure, fit.pose, seen.tangent_basis)
    found = slopes(anchors.structure, fit.pose, seen.tangent_basis, projection)
    # Rows: by the five unknowns of the view and the shrinkage, and the residual; by errors of the
    # window.
    own = np.empty((len(seen.rows), 2, VIEW + 2))
    own[..., :VIEW] = found[BY_VIEW].T
    offsets = geometry.unknowns.offsets[:, None, seen.rows]
    withdrawing = np.add.reduce(found[OFFSETS] * offsets, axis=0).T
    np.negative(withdrawing, out=own[..., VIEW])
    own[..., -1] = projection.residuals.T
    whitening, shared = _whitening(geometry, seen.rows, found, fit)
    beside, by_mount = _prior_rows(geometry, fit.pose, shrinkage)
    rows = np.concatenate([(whitening @ own).reshape(-1, VIEW + 2), beside])
    shared = np.concatenate([(whitening @ shared).reshape(2 * len(own), -1), by_mount])
    joint = shared.T @ shared
    joint.ravel()[:: len(joint) + 1] += 1.0  # errors of the window, one deviation each
    left = rows - shared @ np.linalg.solve(joint, shared.T @ rows)
    matrix = rows[:, :-1].T @ left[:, :-1]
    matrix.ravel()[: VIEW * (VIEW + 2) : VIEW + 2] += LEAST_PLACE  # of the view
    covariance = np.linalg.inv(matrix)
    gain = covariance @ left[:, :-1].T
    covariance = 0.5 * (covariance + covariance.T)
    after, pose, shift = _stepped(fit.pose, gain @ rows[:, -1], covariance)
    gain, count = gain[:VIEW], len(beside)
    by_residual = gain[:, :-count].reshape(VIEW, -1, 1, 2) @ whitening
    seen_noise = math.sqrt(fit.spread) * by_residual.reshape(VIEW, -1)
    noise = np.concatenate([seen_noise, gain[:, -count:]], axis=1)
    covariance = covariance[:VIEW, :VIEW]
    own_covariance = noise @ noise.T
    place = MapLocalization(pose, covariance, own_covariance, geometry, fit.inliers, shift)
    return place, after


def _stepped(
    pose: FloatArray, step: FloatArray, covariance: FloatArray
) -> tuple[Shrinkage, FloatArray, FloatArray]:
    """Return the shrinkage after a ``step``, (6,), the pose, and what withdrawing moves it by."""
    variance = max(float(covariance[VIEW, VIEW]), LEAST_VARIANCE)
    after = Shrinkage(min(max(-float(step[VIEW]), 0.0), 1.0), variance)
    by_share = covariance[:VIEW, VIEW] / covariance[VIEW, VIEW]
    shift = after.withdrawn * by_share
    return after, pose - step[:VIEW] + step[VIEW] * by_share + shift, shift


def _whitening(
    geometry: Geometry, rows: IntArray, found: FloatArray, fit: PoseFit
) -> tuple[FloatArray, FloatArray]:
    """
    Return what makes residuals of features independent, (n, 2, 2), lower triangles.

    And what errors of the window make of them, (n, 2, r).
    """
    root = geometry.root
    common = np.empty((len(rows), 6, len(root)))  # by features, then by the photograph
    common[:, :3], common[:, 3:] = geometry.feature_roots[rows], root[-SHARED:-2]
    slopes = found[BY_FEATURE.start :].transpose(2, 1, 0)  # of the feature, then of what all share
    alone = slopes[..., :3] @ geometry.system.roots[rows]
    blocks = np.eye(2) + alone @ alone.swapaxes(1, 2)
    weight = np.sqrt(robust_weight(fit.squares / fit.widening) / fit.spread)
    # The inverted root of [[a, b], [b, c]].
    a, b, c = blocks[:, 0, 0], blocks[:, 0, 1], blocks[:, 1, 1]
    whitening = np.zeros_like(blocks)
    whitening[:, 0, 0], whitening[:, 1, 1] = weight / np.sqrt(a), weight / np.sqrt(c - b * b / a)
    whitening[:, 1, 0] = -b / a * whitening[:, 1, 1]
    return whitening, slopes @ common


def _prior_rows(
    geometry: Geometry, pose: FloatArray, shrinkage: Shrinkage
) -> tuple[FloatArray, FloatArray]:
    """Return rows of tilt and roll, off those of the mount by the floor, and of the shrinkage."""
    jitter = geometry.evaluation.factors.jitter
    tilt, roll = ((pose[TILT:] - geometry.unknowns.shared[MOUNT]) / jitter).tolist()
    certain, deviation = 1.0 / jitter, math.sqrt(shrinkage.variance)
    rows = np.array(
        [
            [0.0, 0.0, 0.0, certain, 0.0, 0.0, tilt],
            [0.0, 0.0, 0.0, 0.0, certain, 0.0, roll],
            [0.0, 0.0, 0.0, 0.0, 0.0, 1.0 / deviation, -shrinkage.share / deviation],
        ]
    )
    shared = np.zeros((3, len(geometry.root)))
    np.negative(geometry.root[-2:] / jitter, out=shared[:2])
    return rows, shared
