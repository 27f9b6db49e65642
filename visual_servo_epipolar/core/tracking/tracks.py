"""Tracks: the features tracked at a time, and the tests by which outliers are dropped."""

from dataclasses import dataclass, replace

import numpy as np

from visual_servo_epipolar.core.arrays import BoolArray, FloatArray, IntArray, median
from visual_servo_epipolar.core.tracking.alignment.warps import keeps_all, numbers, Warps
from visual_servo_epipolar.core.tracking.canvas import Canvas

MIN_FEATURES = 15  # below which a test of outliers says nothing
RESIDUAL_FACTOR, RESIDUAL_FLOOR = 3.0, 2.0  # limit: times the median, plus grey levels


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
        if keeps_all(rows):
            return self
        rows = numbers(rows)
        return Tracks(self.warps.take(rows), self.ages.take(rows), self.residuals.take(rows))

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
