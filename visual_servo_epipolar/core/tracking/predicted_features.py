"""
Predicted features: the positions of candidates that are out of sight.

A feature that is lost behind an obstacle, or that left the image, moves on with the features
around it: by an affine motion fitted to all tracked ones from frame to frame, plus the residuals
of those near it.
"""

from dataclasses import dataclass, replace

import numpy as np

from visual_servo_epipolar.core.arrays import BoolArray, FloatArray, IntArray, median
from visual_servo_epipolar.core.lapack import solved
from visual_servo_epipolar.core.tracking.alignment.warps import (
    contained,
    numbers,
    squared_lengths,
    Warps,
)

STALE_FRAMES = 100  # added to the age of a prediction by a frame without a motion to follow
MAX_UNSEEN = 40  # frames for which a prediction is followed
MIN_SUPPORT = 6  # tracked features below which no motion is fitted
ROUNDS = 2  # of reweighting, so that one outlier does not drag the others along
RIDGE = 1e-6 * np.eye(3)  # features in a row leave one direction open
NEAR_PX = 60.0  # distance within which residuals of other features count
OUTLIER_PX = 8.0  # distance from the motion of most at which a feature is an outlier
OUTLIER_MEDIANS = 5.0  # residual of an outlier, in medians of all, beyond its limit


@dataclass(frozen=True, slots=True, eq=False)
class PredictedFeatures:
    """Last seen or predicted ``warps`` of N candidates; frames ``unseen`` of each, shape (N,)."""

    warps: Warps
    unseen: IntArray

    @classmethod
    def empty(cls) -> 'PredictedFeatures':
        """Return predictions of no feature."""
        return cls(Warps.empty(), np.empty(0, np.int64))

    def corrected(self, tracked: Warps) -> 'PredictedFeatures':
        """Return the predictions with those of ``tracked`` features replaced or added."""
        untracked = numbers(~contained(self.warps.ids, tracked.ids))
        return PredictedFeatures(
            self.warps.take(untracked).joined(tracked),
            np.concatenate([self.unseen.take(untracked), np.zeros(len(tracked), np.int64)]),
        )

    def propagated(self, motion: 'ImageMotion | None', tracked: IntArray) -> 'PredictedFeatures':
        """
        Return the predictions one frame later; without a ``motion`` they become stale.

        Only what is followed moves: not the features ``tracked``, shape (M,), which will be
        corrected, and not what has been out of sight for too long.
        """
        if motion is None:
            return replace(self, unseen=self.unseen + STALE_FRAMES)
        lost = numbers(~contained(self.warps.ids, tracked) & (self.unseen <= MAX_UNSEEN))
        current = self.warps.current.copy()
        current[lost] = motion.applied(current.take(lost, axis=0))
        return PredictedFeatures(replace(self.warps, current=current), self.unseen + 1)

    def select(self, ids: IntArray) -> 'PredictedFeatures':
        """Return the predictions of the features ``ids``, shape (M,)."""
        rows = numbers(contained(self.warps.ids, ids))
        return PredictedFeatures(self.warps.take(rows), self.unseen.take(rows))


class Predictions:
    """Predictions of a tracker, which follow the last motion not before somebody needs them."""

    def __init__(self) -> None:
        self._features = PredictedFeatures.empty()
        self._motion: tuple[ImageMotion | None, IntArray] | None = None  # to be followed yet

    def follow(self, last: Warps, tracked: Warps) -> BoolArray:
        """
        Follow the motion from the ``last`` frame to the M features ``tracked`` in this one.

        These are in the order of the last frame. Returns which move as most do, shape (M,).
        """
        self._catch_up()
        before = last.current
        if len(tracked) < len(last):
            before = before[contained(last.ids, tracked.ids)]
        motion = fit_motion(before, tracked.current)
        self._motion = motion, tracked.ids
        if motion is None:
            return np.ones(len(tracked), bool)
        return ~motion.outliers(before, tracked.current, OUTLIER_PX)

    def correct(self, tracked: Warps) -> None:
        """Replace or add the predictions of ``tracked`` features."""
        self._catch_up()
        self._features = self._features.corrected(tracked)

    def select(self, ids: IntArray) -> PredictedFeatures:
        """Return the predictions of the features ``ids``, shape (M,)."""
        self._catch_up()
        return self._features.select(ids)

    def _catch_up(self) -> None:
        if self._motion is not None:
            self._features, self._motion = self._features.propagated(*self._motion), None


@dataclass(frozen=True, slots=True, eq=False)
class ImageMotion:
    """
    Motion of features from frame to frame: an affine map, and the residuals of its support.

    ``affine``, shape (3, 2), maps rows (u, v, 1) [px]; ``support``, shape (N, 2), are the pixels
    before the motion to which it was fitted; ``residuals``, shape (N, 2), weighted [px].
    """

    affine: FloatArray
    support: FloatArray
    residuals: FloatArray

    def applied(self, pixels: FloatArray) -> FloatArray:
        """
        Return the new positions of ``pixels``, shape (M, 2).

        The affine map, plus the mean of the residuals under weights 1 / (distance^2 + NEAR_PX^2).
        """
        squared = pixels @ (-2.0 * self.support.T)
        squared += squared_lengths(pixels)[:, None] + (squared_lengths(self.support) + NEAR_PX**2)
        weight = np.divide(1.0, squared, out=squared)
        local = (weight @ self.residuals) / weight.sum(axis=1, keepdims=True)
        return np.asarray(_homogeneous(pixels) @ self.affine + local)

    def outliers(self, before: FloatArray, after: FloatArray, limit: float) -> BoolArray:
        """
        Return which features left the affine motion, shape (M,).

        Positions ``before`` and ``after`` have shape (M, 2); outliers are farther from the map
        than ``limit`` [px] plus OUTLIER_MEDIANS medians.
        """
        off = after - _homogeneous(before) @ self.affine
        residual = np.sqrt(squared_lengths(off))
        return np.asarray(residual > limit + OUTLIER_MEDIANS * median(residual))


def fit_motion(before: FloatArray, after: FloatArray) -> ImageMotion | None:
    """
    Fit the motion of features from ``before`` to ``after``, pixels of shape (N, 2) each.

    Iteratively reweighted least squares. Returns None of fewer than MIN_SUPPORT features.
    """
    if len(before) < MIN_SUPPORT:
        return None
    centre = np.add.reduce(before, axis=0) / len(before)
    rows, weight = _homogeneous(before - centre), np.ones(len(before))
    for _ in range(ROUNDS):
        weighted = rows.T * (weight * weight)
        affine = solved(weighted @ rows + RIDGE, weighted @ after)
        residual = np.sqrt(squared_lengths(after - rows @ affine))
        weight = 1.0 / (1.0 + (residual / (2.0 * median(residual) + 0.1)) ** 2)
    residuals: FloatArray = (after - rows @ affine) * weight[:, None]
    affine[2] -= centre @ affine[:2]
    return ImageMotion(np.asarray(affine, dtype=np.float64), before, residuals)


def _homogeneous(pixels: FloatArray) -> FloatArray:
    rows = np.ones((len(pixels), 3))
    rows[:, :2] = pixels
    return rows
