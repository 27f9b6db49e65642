"""Tracks: the features tracked at a time, their motion, and tests that drop outliers."""

from dataclasses import dataclass, replace
import math

import numpy as np

from visual_servo_epipolar.core.arrays import BoolArray, FloatArray, IntArray, median
from visual_servo_epipolar.core.geometry.least_squares import cauchy, RIDGE, robust_fit
from visual_servo_epipolar.core.geometry.rays import homogeneous
from visual_servo_epipolar.core.tracking.canvas import Canvas
from visual_servo_epipolar.core.tracking.warps import squared_lengths, Warps

MIN_FEATURES = 15  # below which a test of outliers says nothing
RESIDUAL_FACTOR, RESIDUAL_FLOOR = 3.0, 2.0  # limit: times the median, plus grey levels
MIN_SUPPORT = 6  # tracked features below which no motion is fitted
ROUNDS = 2  # of reweighting, so that one outlier does not drag the others along
NEAR_PX = 60.0  # distance within which residuals of other features count
OUTLIER_MEDIANS = 5.0  # residual of an outlier, in medians of all, beyond its limit


@dataclass(frozen=True, slots=True, eq=False)
class Tracks:
    """Tracks of N features: ``warps``, ``ages`` [frames], ``residuals`` [grey levels], (N,)."""

    warps: Warps
    ages: IntArray
    residuals: FloatArray

    @classmethod
    def empty(cls) -> 'Tracks':
        """Return the tracks of no feature."""
        return cls.detected(Warps.empty())

    @classmethod
    def detected(cls, warps: Warps) -> 'Tracks':
        """Return the tracks of features detected in this frame."""
        return cls(warps, np.zeros(len(warps), np.int64), np.zeros(len(warps)))

    def __len__(self) -> int:
        return len(self.warps)

    def take(self, rows: IntArray | BoolArray) -> 'Tracks':
        """Return the rows chosen by index, shape (M,), or mask, shape (N,)."""
        return Tracks(self.warps.take(rows), self.ages[rows], self.residuals[rows])

    def joined(self, more: 'Tracks') -> 'Tracks':
        """Return these tracks followed by ``more``."""
        return Tracks(
            self.warps.joined(more.warps),
            np.concatenate([self.ages, more.ages]),
            np.concatenate([self.residuals, more.residuals]),
        )

    def followed(self, pixels: FloatArray, valid: BoolArray) -> 'Tracks':
        """Return those that are ``valid``, (N,), a frame later, at ``pixels``, (N, 2)."""
        warps = replace(self.warps, current=pixels)
        return Tracks(warps, self.ages + 1, self.residuals).take(valid)

    def without_residual_outliers(self) -> 'Tracks':
        """
        Drop features whose residual exceeds RESIDUAL_FACTOR medians plus RESIDUAL_FLOOR.

        Such a patch lies across an edge in depth, and its parts pull in different directions.
        """
        if len(self) < MIN_FEATURES:
            return self
        limit = RESIDUAL_FACTOR * median(self.residuals) + RESIDUAL_FLOOR
        return self.take(self.residuals <= limit)

    def without_epipolar_outliers(self, canvas: Canvas) -> 'Tracks':
        """
        Drop features off the common epipolar geometry: mistaken twins.

        Where it has less than half of them as inliers it is no judge, and nothing is dropped.
        """
        if len(self) < MIN_FEATURES:
            return self
        pixels = self.warps.current, self.warps.desired
        if canvas.agree(*pixels):
            return self
        _, inliers = canvas.geometry(*pixels)
        return self.take(inliers) if 2 * int(inliers.sum()) >= len(self) else self


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

    def applied(self, pixels: FloatArray, near: float = NEAR_PX, power: float = 1.0) -> FloatArray:
        """
        Return the new positions of ``pixels``, shape (M, 2).

        The affine map, plus the mean of the residuals under weights 1 / (distance^2 + near^2), to
        a ``power``: the smaller ``near`` [px] and the higher that is, the less smooth is the map.
        """
        squared = pixels @ (-2.0 * self.support.T)
        squared += squared_lengths(pixels)[:, None] + (squared_lengths(self.support) + near**2)
        weight = np.divide(1.0, squared, out=squared)
        if power != 1.0:
            weight **= power
        local = (weight @ self.residuals) / weight.sum(axis=1, keepdims=True)
        return np.asarray(homogeneous(pixels) @ self.affine + local)

    def outliers(self, before: FloatArray, after: FloatArray, limit: float) -> BoolArray:
        """
        Return which features, ``before`` and ``after`` of shape (M, 2), left the affine motion.

        They are farther from the map than ``limit`` [px] plus OUTLIER_MEDIANS medians.
        """
        off = after - homogeneous(before) @ self.affine
        residual = np.sqrt(squared_lengths(off))
        return np.asarray(residual > limit + OUTLIER_MEDIANS * median(residual))


def fit_motion(before: FloatArray, after: FloatArray) -> ImageMotion | None:
    """
    Fit the motion of features from ``before`` to ``after``, (N, 2) each; None of too few.

    By iteratively reweighted least squares.
    """
    if len(before) < MIN_SUPPORT:
        return None
    centre = np.add.reduce(before, axis=0) / len(before)
    fit = robust_fit(homogeneous(before - centre), after, _weights, ROUNDS, RIDGE)
    assert fit is not None
    affine = fit.solution
    residuals: FloatArray = fit.residual * np.sqrt(_weights(fit.residual))[:, None]
    affine[2] -= centre @ affine[:2]
    return ImageMotion(affine, before, residuals)


def _weights(off: FloatArray) -> FloatArray:
    squares = squared_lengths(off)
    usual = 2.0 * math.sqrt(median(squares)) + 0.1
    return np.asarray(cauchy(squares, usual * usual) ** 2)
