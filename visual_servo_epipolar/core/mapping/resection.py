"""
Resection: the pose of one view on the structure, with the covariance of the window.

After the steps of ``fitting`` one with the covariance of the whole structure: what features share
(errors of keyframes) does not average out over them.

Shrinkage: the share of the keyframes' corrections that a view near the goal does not confirm.

Keyframes correct the rays of the photograph, whose noise they average. What a tracker gets wrong,
though, is not noise: from afar a patch looks another, and is aligned with an error that is about
the same in all views, while near the goal, where the image is that of the photograph, there is
none. So a view near the goal tells by which share the corrections are to be withdrawn: by hardly
any where there is noise alone.
"""

from dataclasses import dataclass
import math
from typing import NamedTuple

import numpy as np

from visual_servo_epipolar.core.arrays import BoolArray, FloatArray
from visual_servo_epipolar.core.mapping.adjustment.equations import robust_weight
from visual_servo_epipolar.core.mapping.adjustment.projection import (
    BY_FEATURE,
    BY_VIEW,
    INVERSE_DEPTH,
    project,
    slopes,
)
from visual_servo_epipolar.core.mapping.adjustment.refinement import Geometry
from visual_servo_epipolar.core.mapping.adjustment.window import MOUNT, TILT, VIEW
from visual_servo_epipolar.core.mapping.fitting import (
    Anchors,
    errors_of,
    FeatureErrors,
    MatchedFeatures,
    PoseFit,
    RIDGE,
)

OFFSETS = slice(BY_FEATURE.start, INVERSE_DEPTH)  # of the slopes by a feature's unknowns

ALIKE = 0.05  # of the depth: how near the goal views look as the photograph does
DRIFT = 0.04  # of the share, from view to view: what looks alike changes with the distance
LEAST_VARIANCE = 1e-6
# Shares up to which nothing, and from which all is withdrawn: noise alone makes some hundredths,
# and what features have in common, which displaces most, shows least in what they disagree on.
CHANCE, ALL = 0.2, 0.5


@dataclass(frozen=True, slots=True)
class Shrinkage:
    """The ``share`` of the corrections that views do not confirm, and its ``variance``."""

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


def shrinkage_of(share: float, variance: float) -> Shrinkage:
    """Return the shrinkage with an estimated ``share``, brought into its range of 0 to 1."""
    return Shrinkage(min(max(share, 0.0), 1.0), max(variance, LEAST_VARIANCE))


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


def resect(
    geometry: Geometry,
    anchors: Anchors,
    seen: MatchedFeatures,
    fit: PoseFit,
    shrinkage: Shrinkage,
    *,
    errors: FeatureErrors | None = None,
) -> Resection:
    """Return the pose and its covariance, after one step with the whole structure's errors."""
    errors = errors_of(geometry, seen.rows) if errors is None else errors
    projection = project(anchors.structure, fit.pose, seen.tangent_basis)
    found = fit.slopes
    if found is None:
        found = slopes(anchors.structure, fit.pose, seen.tangent_basis, projection)
    # Rows: by the five unknowns of the view and the shrinkage, and the residual; by errors of the
    # window.
    own = np.empty((len(seen.rows), 2, VIEW + 2))
    own[..., :VIEW] = found[BY_VIEW].T
    withdrawing = np.add.reduce(found[OFFSETS] * errors.offsets, axis=0).T
    np.negative(withdrawing, out=own[..., VIEW])
    own[..., -1] = projection.residuals.T
    whitening, shared = _whitening(errors, found, fit)
    beside, by_mount = _prior_rows(geometry, errors, fit.pose, shrinkage)
    rows = np.concatenate([whitening.rows(own), beside])
    shared = np.concatenate([whitening.rows(shared), by_mount])
    joint = shared.T @ shared
    joint.ravel()[:: len(joint) + 1] += 1.0  # errors of the window, one deviation each
    left = rows - shared @ np.linalg.solve(joint, shared.T @ rows)
    matrix = rows[:, :-1].T @ left[:, :-1]
    matrix.ravel()[: VIEW * (VIEW + 2) : VIEW + 2] += RIDGE  # of the view
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
    """What makes residuals of a feature independent: [[first, 0], [mixed, other]], (n,) each."""

    both: FloatArray  # first and other, (n, 2)
    mixed: FloatArray

    def rows(self, part: FloatArray) -> FloatArray:
        """Return rows of residuals, (n, 2, C), which become independent: (2 n, C)."""
        mixed = self.mixed[:, None] * part[:, 0]
        part *= self.both[..., None]
        part[:, 1] += mixed
        return part.reshape(-1, part.shape[-1])

    def columns(self, part: FloatArray) -> FloatArray:
        """Return columns, (C, 2 n), by residuals instead of what is independent."""
        columns = part * self.both.ravel()
        columns[:, ::2] += part[:, 1::2] * self.mixed
        return columns


def _whitening(
    errors: FeatureErrors, found: FloatArray, fit: PoseFit
) -> tuple[_Whitening, FloatArray]:
    """Return what makes residuals of features independent, and errors of the window, (n, 2, r)."""
    slopes = found[BY_FEATURE.start :].transpose(2, 1, 0)  # of the feature, then of what all share
    alone = slopes[..., :3] @ errors.own
    first, other = alone[:, 0], alone[:, 1]
    a, b, c = 1.0 + _dot(first, first), _dot(first, other), _dot(other, other)
    weight = np.sqrt(robust_weight(fit.squares / fit.widening))
    # The inverted root of [[a, b], [b, 1 + c]].
    ratio, both = b / a, np.empty((len(a), 2))
    rest = np.divide(weight, np.sqrt(1.0 + c - b * ratio), out=both[:, 1])
    np.divide(weight, np.sqrt(a), out=both[:, 0])
    return _Whitening(both, -ratio * rest), slopes @ errors.shared


def _dot(first: FloatArray, other: FloatArray) -> FloatArray:
    return np.asarray(np.add.reduce(first * other, axis=1))


def _prior_rows(
    geometry: Geometry, errors: FeatureErrors, pose: FloatArray, shrinkage: Shrinkage
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
    shared = np.zeros((3, errors.attitude.shape[1]))
    np.negative(errors.attitude, out=shared[:2])
    return rows, shared
