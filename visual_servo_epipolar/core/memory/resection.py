"""
Resection: the pose of one view on the structure, which is known as well as the window tells.

After the steps of ``fitting`` one with the covariance of the whole structure: what features share
(errors of keyframes) does not average out over them.
"""

import math
from typing import NamedTuple

import numpy as np

from visual_servo_epipolar.core.arrays import BoolArray, FloatArray
from visual_servo_epipolar.core.memory.adjustment.equations import robust_weight
from visual_servo_epipolar.core.memory.adjustment.projection import (
    BY_FEATURE,
    BY_VIEW,
    NEARNESS,
    projected,
    slopes,
)
from visual_servo_epipolar.core.memory.adjustment.refinement import Geometry
from visual_servo_epipolar.core.memory.adjustment.window import MOUNT, TILT, VIEW
from visual_servo_epipolar.core.memory.errors import Errors, errors_of
from visual_servo_epipolar.core.memory.fitting import (
    Anchors,
    DIAGONAL,
    Fit,
    LEAST_NEARNESS,
    Seen,
)
from visual_servo_epipolar.core.memory.shrinkage import Shrinkage, shrinkage_of

OFFSETS = slice(BY_FEATURE.start, NEARNESS)  # of the slopes by a feature's unknowns


class Resection(NamedTuple):
    """
    Pose of a view, (5,), its covariance, (5, 5), and ``inliers``, (n,).

    ``own`` is the part of the covariance that is this view's alone, and averages out over views;
    ``shrinkage`` is that of the photograph's corrections, with what this view tells of it, and
    ``shift``, (5,), what of the pose is due to what is withdrawn.
    """

    pose: FloatArray
    covariance: FloatArray
    own: FloatArray
    inliers: BoolArray
    squares: FloatArray
    shrinkage: Shrinkage
    shift: FloatArray


def resected(
    geometry: Geometry,
    anchors: Anchors,
    seen: Seen,
    fit: Fit,
    shrinkage: Shrinkage,
    *,
    errors: Errors | None = None,
) -> Resection:
    """
    Return the pose and its covariance, after one step with the whole structure's errors.

    ``shrinkage`` is what was known of it before this view: it is one more unknown of the step.
    ``errors`` are those of the features that are seen, where somebody has looked them up.
    """
    errors = errors_of(geometry, seen.rows) if errors is None else errors
    view, sides = fit.pose[None], seen.sides[None]
    projection = projected(anchors.structure, view, sides)
    found = fit.slopes
    if found is None:
        found = slopes(anchors.structure, view, sides, projection)[0]
    # Rows: by the five unknowns of the view and the shrinkage, and the residual; by errors of the
    # window.
    withdrawing = -(found[OFFSETS] * errors.offsets).sum(0)
    columns = [found[BY_VIEW], withdrawing[None], projection.residuals]
    own = np.concatenate(columns).transpose(2, 1, 0)
    whitening, shared = _whitening(errors, found, fit)
    beside, by_mount = _prior_rows(geometry, errors, fit.pose, shrinkage)
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
    after, pose, shift = _stepped(fit.pose, gain @ rows[:, -1], covariance)
    gain, count = gain[:VIEW], len(beside)
    noise = np.concatenate([whitening.columns(gain[:, :-count]), gain[:, -count:]], axis=1)
    covariance = covariance[:VIEW, :VIEW]
    return Resection(pose, covariance, noise @ noise.T, fit.inliers, fit.squares, after, shift)


def _stepped(
    pose: FloatArray, step: FloatArray, covariance: FloatArray
) -> tuple[Shrinkage, FloatArray, FloatArray]:
    """Return the shrinkage after a ``step``, (6,), the pose, and what withdrawing moves it by."""
    after = shrinkage_of(-float(step[VIEW]), float(covariance[VIEW, VIEW]))
    by_share = covariance[:VIEW, VIEW] / covariance[VIEW, VIEW]
    shift = after.withdrawn * by_share
    return after, pose - step[:VIEW] + step[VIEW] * by_share + shift, shift


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


def _whitening(errors: Errors, found: FloatArray, fit: Fit) -> tuple[_Whitening, FloatArray]:
    """
    Return what makes residuals of each feature independent, and errors of the window.

    Those are slopes of residuals by errors of keyframes and the shared attitude, (n, 2, r).
    """
    slopes = found[BY_FEATURE.start :].transpose(2, 1, 0)  # of the feature, then of what all share
    alone = slopes[..., :3] @ errors.own
    first, other = alone[:, 0], alone[:, 1]
    a, b, c = 1.0 + (first * first).sum(1), (first * other).sum(1), (other * other).sum(1)
    weight = np.sqrt(robust_weight(fit.squares / fit.widening))
    # The inverted root of [[a, b], [b, 1 + c]].
    ratio = b / a
    rest = weight / np.sqrt(1.0 + c - b * ratio)
    return _Whitening(weight / np.sqrt(a), -ratio * rest, rest), slopes @ errors.shared


def _prior_rows(
    geometry: Geometry, errors: Errors, pose: FloatArray, shrinkage: Shrinkage
) -> tuple[FloatArray, FloatArray]:
    """Return rows of tilt and roll, off those of the mount by the floor, and of the shrinkage."""
    jitter = geometry.evaluation.factors.jitter
    rows = np.zeros((3, VIEW + 2))
    rows[0, TILT] = rows[1, TILT + 1] = 1.0 / jitter
    rows[:2, -1] = (pose[TILT:] - geometry.unknowns.shared[MOUNT]) / jitter
    deviation = math.sqrt(shrinkage.variance)
    rows[2, VIEW], rows[2, -1] = 1.0 / deviation, -shrinkage.share / deviation
    shared = np.zeros((3, errors.attitude.shape[1]))
    np.negative(errors.attitude, out=shared[:2])
    return rows, shared
