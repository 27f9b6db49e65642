"""
Resection: the pose of one view on the structure, which is known as well as the window tells.

A few steps with each feature's own covariance, then one with that of the whole structure: what
features share (errors of keyframes) does not average out over them.
"""

from dataclasses import dataclass
import math
from typing import NamedTuple

import numpy as np

from visual_servo_epipolar.core.arrays import BoolArray, FloatArray, IntArray, median
from visual_servo_epipolar.core.memory.equations import OUTLIER, robust_weight
from visual_servo_epipolar.core.memory.factors import LEAST_JITTER
from visual_servo_epipolar.core.memory.projection import (
    BY_FEATURE,
    BY_SHARED,
    BY_VIEW,
    is_ahead,
    OPPOSITE,
    projected,
    Projection,
    slopes,
    squares_of,
    Structure,
)
from visual_servo_epipolar.core.memory.refinement import Geometry
from visual_servo_epipolar.core.memory.shrinkage import Shrinkage, shrinkage_of
from visual_servo_epipolar.core.memory.window import HEADING, MOUNT, SHARED, TILT, VIEW

STEPS = 8
LEAST_STEP = 0.1  # squared, in deviations, below which the last step does the rest
FAR = 1e3  # squared, likewise, from which slopes are taken anew
USUAL_MEDIAN = 1.3863  # of squares of two coordinates
LEAST_NEARNESS = 1e-6  # information of what no feature shows [1/m^2]
DIAGONAL = np.diag_indices(VIEW)
OFFSETS = slice(5, 7)


@dataclass(frozen=True, eq=False)
class Seen:
    """What a view shows of features that are remembered: ``rows``, (n,), of the structure."""

    rows: IntArray
    rays: FloatArray  # (3, n)
    sides: FloatArray  # (2, 3, n)


@dataclass(frozen=True, eq=False)
class Anchors:
    """
    Features of a ``structure``, each with its own ``covariance``, (3, 3, n).

    ``attitude`` and ``deviation``, (2,), of tilt and roll are what is known of any view.
    """

    structure: Structure
    covariance: FloatArray
    attitude: FloatArray
    deviation: FloatArray

    def of(self, rows: IntArray) -> 'Anchors':
        """Return the anchors of these features alone."""
        rays, by_unknowns, nearness, stretch = self.structure
        structure = Structure(rays[:, rows], by_unknowns[..., rows], nearness[rows], stretch)
        covariance = self.covariance[..., rows]
        return Anchors(structure, covariance, self.attitude, self.deviation)


class Fit(NamedTuple):
    """Pose of a view, (5,), squared residuals, (n,), and how many times wider they are."""

    pose: FloatArray
    squares: FloatArray
    widening: float

    @property
    def inliers(self) -> BoolArray:
        """Which features agree."""
        return np.asarray(self.squares <= OUTLIER)


class Resection(NamedTuple):
    """
    Pose of a view, (5,), its covariance, (5, 5), and ``inliers``, (n,).

    ``own`` is the part of the covariance that is this view's alone, and averages out over views;
    ``shrinkage`` is that of the photograph's corrections, with what this view tells of it.
    """

    pose: FloatArray
    covariance: FloatArray
    own: FloatArray
    inliers: BoolArray
    squares: FloatArray
    shrinkage: Shrinkage


def anchors_of(geometry: Geometry) -> Anchors:
    """Return the features of a refined window as anchors."""
    jitter = max(geometry.evaluation.factors.mount.jitter, LEAST_JITTER)
    spread = (geometry.root[-2:] ** 2).sum(1)
    return Anchors(
        geometry.evaluation.structure,
        geometry.feature_covariance,
        geometry.unknowns.shared[MOUNT],
        np.sqrt(jitter * jitter + spread),
    )


class _Slopes(NamedTuple):
    """Slopes of residuals by the view, (5, 2, n), and what those tell, at some pose."""

    own: FloatArray
    told: FloatArray  # inverted covariances of residuals, (2, 2, n)
    weighted: FloatArray  # slopes times those


def _slopes(anchors: Anchors, seen: Seen, pose: FloatArray, projection: Projection) -> _Slopes:
    found = slopes(anchors.structure, pose[None], seen.sides[None], projection)[0]
    told = _information(found[BY_FEATURE], anchors.covariance)
    return _Slopes(found[BY_VIEW], told, _times(told, found[BY_VIEW]))


def fitted(anchors: Anchors, seen: Seen, start: FloatArray) -> Fit:
    """Return the pose that fits best, from ``start``, (5,), by features as if independent."""
    pose, widening, squares = start, 1.0, np.zeros(len(seen.rows))
    at: _Slopes | None = None
    known = anchors.deviation**-2
    ridge = np.concatenate([np.zeros(TILT), known]) + LEAST_NEARNESS
    for _ in range(STEPS):
        projection = projected(anchors.structure, pose[None], seen.sides[None])
        residuals = projection.residuals[0]
        at = _slopes(anchors, seen, pose, projection) if at is None else at
        ahead = is_ahead(projection, seen.rays[None])[0]
        squares = np.where(ahead, (_times(at.told, residuals) * residuals).sum(0), OPPOSITE)
        widening = max(1.0, median(squares) / USUAL_MEDIAN)
        rows = (at.weighted * robust_weight(squares / widening)).reshape(VIEW, -1)
        matrix = rows @ at.own.reshape(VIEW, -1).T
        matrix[DIAGONAL] += ridge
        vector = rows @ residuals.ravel()
        vector[TILT:] += known * (pose[TILT:] - anchors.attitude)
        step = np.linalg.solve(matrix, vector)
        pose = pose - step
        moved = step @ vector
        if moved < LEAST_STEP * widening:
            break
        at = at if moved < FAR else None
    return Fit(pose, squares, widening)


def _information(own: FloatArray, covariance: FloatArray) -> FloatArray:
    """Return inverted covariances, (2, 2, n), of residuals with slopes ``own``, (3, 2, n)."""
    turned = (covariance[:, :, None] * own[None]).sum(1)  # (3, 2, n)
    spread = (own[:, :, None] * turned[:, None]).sum(0)  # (2, 2, n)
    a, b, c = spread[0, 0] + 1.0, spread[0, 1], spread[1, 1] + 1.0
    return np.asarray(np.array([[c, -b], [-b, a]]) / (a * c - b * b))


def _times(matrices: FloatArray, vectors: FloatArray) -> FloatArray:
    """Return matrices, (2, 2, n), times vectors, (..., 2, n)."""
    product = matrices[:, 0] * vectors[..., 0, None, :] + matrices[:, 1] * vectors[..., 1, None, :]
    return np.asarray(product)


def resected(
    geometry: Geometry, anchors: Anchors, seen: Seen, fit: Fit, shrinkage: Shrinkage
) -> Resection:
    """
    Return the pose and its covariance, after one step with the whole structure's errors.

    ``shrinkage`` is what was known of it before this view: it is one more unknown of the step.
    """
    view, sides = fit.pose[None], seen.sides[None]
    projection = projected(anchors.structure, view, sides)
    found = slopes(anchors.structure, view, sides, projection)[0]
    # Rows: by the five unknowns of the view and the shrinkage, and the residual; by errors of the
    # window.
    withdrawing = -(found[OFFSETS] * geometry.unknowns.offsets[:, None, seen.rows]).sum(0)
    columns = [found[BY_VIEW], withdrawing[None], projection.residuals]
    own = np.concatenate(columns).transpose(2, 1, 0)
    whitening, shared = _whitening(geometry, seen, found, fit)
    beside, by_mount = _prior_rows(geometry, fit.pose, shrinkage)
    rows = np.concatenate([whitening.rows(own), beside])
    shared = np.concatenate([whitening.rows(shared), by_mount])
    joint = shared.T @ shared
    joint.ravel()[:: len(joint) + 1] += 1.0  # errors of the window, one deviation each
    left = rows - shared @ np.linalg.solve(joint, shared.T @ rows)
    matrix = rows[:, :-1].T @ left[:, :-1]
    matrix[DIAGONAL] += LEAST_NEARNESS
    covariance = np.linalg.inv(matrix)
    gain = covariance @ left[:, :-1].T
    covariance = 0.5 * (covariance + covariance.T)
    after, pose = _stepped(fit.pose, gain @ rows[:, -1], covariance)
    gain, count = gain[:VIEW], len(beside)
    noise = np.concatenate([whitening.columns(gain[:, :-count]), gain[:, -count:]], axis=1)
    covariance = covariance[:VIEW, :VIEW]
    return Resection(pose, covariance, noise @ noise.T, fit.inliers, fit.squares, after)


def _stepped(
    pose: FloatArray, step: FloatArray, covariance: FloatArray
) -> tuple[Shrinkage, FloatArray]:
    """Return the shrinkage after a ``step``, (6,), and the pose with what is withdrawn by it."""
    after = shrinkage_of(-float(step[VIEW]), float(covariance[VIEW, VIEW]))
    by_share = covariance[:VIEW, VIEW] / covariance[VIEW, VIEW]
    return after, pose - step[:VIEW] + by_share * (after.withdrawn + step[VIEW])


class _Whitening(NamedTuple):
    """What makes residuals of each feature independent: [[first, 0], [mixed, other]], (n,)."""

    first: FloatArray
    mixed: FloatArray
    other: FloatArray

    def rows(self, part: FloatArray) -> FloatArray:
        """Return rows of residuals, (n, 2, C), independent: (2 n, C)."""
        rows = np.empty(part.shape)
        np.multiply(self.first[:, None], part[:, 0], out=rows[:, 0])
        np.multiply(self.other[:, None], part[:, 1], out=rows[:, 1])
        rows[:, 1] += self.mixed[:, None] * part[:, 0]
        return rows.reshape(-1, part.shape[-1])

    def columns(self, part: FloatArray) -> FloatArray:
        """Return columns, (C, 2 n), by residuals instead of what is independent."""
        first, other = part[:, ::2], part[:, 1::2]
        columns = np.empty(part.shape)
        columns[:, ::2] = first * self.first + other * self.mixed
        columns[:, 1::2] = other * self.other
        return columns


def _whitening(
    geometry: Geometry, seen: Seen, found: FloatArray, fit: Fit
) -> tuple[_Whitening, FloatArray]:
    """
    Return what makes residuals of each feature independent, and errors of the window.

    Those are slopes of residuals by errors of keyframes and the shared attitude, (n, 2, D).
    """
    own = found[BY_FEATURE].transpose(2, 1, 0)
    alone = own @ geometry.system.roots[seen.rows]
    first, other = alone[:, 0], alone[:, 1]
    a, b, c = 1.0 + (first * first).sum(1), (first * other).sum(1), (other * other).sum(1)
    weight = np.sqrt(robust_weight(fit.squares / fit.widening))
    # The inverted root of [[a, b], [b, 1 + c]].
    ratio = b / a
    rest = weight / np.sqrt(1.0 + c - b * ratio)
    shared = own @ geometry.feature_roots[seen.rows]
    shared += found[BY_SHARED].transpose(2, 1, 0) @ geometry.root[-SHARED:-2]
    return _Whitening(weight / np.sqrt(a), -ratio * rest, rest), shared


def _prior_rows(
    geometry: Geometry, pose: FloatArray, shrinkage: Shrinkage
) -> tuple[FloatArray, FloatArray]:
    """Return rows of tilt and roll, off those of the mount by the floor, and of the shrinkage."""
    jitter = max(geometry.evaluation.factors.mount.jitter, LEAST_JITTER)
    rows = np.zeros((3, VIEW + 2))
    rows[0, TILT] = rows[1, TILT + 1] = 1.0 / jitter
    rows[:2, -1] = (pose[TILT:] - geometry.unknowns.shared[MOUNT]) / jitter
    deviation = math.sqrt(shrinkage.variance)
    rows[2, VIEW], rows[2, -1] = 1.0 / deviation, -shrinkage.share / deviation
    shared = np.zeros((3, len(geometry.root)))
    shared[:2] = -geometry.root[-2:] / jitter
    return rows, shared


def nearest_view(anchors: Anchors, seen: Seen, views: FloatArray) -> FloatArray:
    """
    Return of ``views``, (K, 5), the one from which features look most alike, turned to fit.

    It is where to start where nothing is known of the pose: pushed, or blind for long.
    """
    bearing = np.arctan2(seen.rays[0], seen.rays[2])
    sides = np.broadcast_to(seen.sides, (len(views), *seen.sides.shape))
    points = projected(anchors.structure, views, sides).points
    off = bearing - np.arctan2(points[:, 0], points[:, 2])
    off = np.sort(np.remainder(off + np.pi, 2.0 * np.pi) - np.pi, axis=1)
    turned = views.copy()
    turned[:, HEADING] += off[:, off.shape[1] // 2]  # a left turn moves the image right
    again = projected(anchors.structure, turned, sides)
    squares = np.sort(squares_of(again, np.broadcast_to(seen.rays, again.points.shape)), axis=1)
    return np.asarray(turned[int(squares[:, squares.shape[1] // 2].argmin())])
