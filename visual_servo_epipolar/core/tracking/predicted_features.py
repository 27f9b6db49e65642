"""
PredictedFeatures: where features are that cannot be seen just now.

A feature that is lost behind an obstacle, or that left the image, moves on with the features
around it: by the affine motion of all of them from frame to frame, plus what the near ones add.
"""

from dataclasses import dataclass, replace

import numpy as np

from visual_servo_epipolar.core.arrays import BoolArray, FloatArray, IntArray
from visual_servo_epipolar.core.tracking.template_alignment import Warps

AGE_OF_THE_LOST = 100  # frames: such a ghost is looked for by its neighbours, not where it was
MIN_SUPPORT = 6  # tracked features below which predicted stand still
ROUNDS = 2  # of reweighting, so that a feature gone astray does not drag the others along
RIDGE = 1e-6 * np.eye(3)  # features in a row leave one direction open
NEAR_PX = 60.0  # how far a feature's own motion reaches


@dataclass(frozen=True, slots=True, eq=False)
class PredictedFeatures:
    """Last known or guessed warps of all candidates; frames since each was seen, shape (N,)."""

    warps: Warps
    unseen: IntArray

    @classmethod
    def none(cls) -> 'PredictedFeatures':
        """Return no predicted."""
        empty = np.empty((0, 2))
        warps = Warps(np.empty(0, np.int64), empty, empty, np.empty((0, 2, 2)))
        return cls(warps, np.empty(0, np.int64))

    def seen(self, warps: Warps) -> 'PredictedFeatures':
        """Return the predicted with those of ``warps`` where they really are, new ones added."""
        others = ~np.isin(self.warps.ids, warps.ids)
        return PredictedFeatures(
            self.warps.take(others).joined(warps),
            np.concatenate([self.unseen[others], np.zeros(len(warps), np.int64)]),
        )

    def aged(self) -> 'PredictedFeatures':
        """Return the predicted one frame later, where nothing says how they moved."""
        return replace(self, unseen=self.unseen + AGE_OF_THE_LOST)

    def moved(self, motion: 'Motion') -> 'PredictedFeatures':
        """Return the predicted one frame later."""
        current = motion.applied(self.warps.current)
        return PredictedFeatures(replace(self.warps, current=current), self.unseen + 1)

    def among(self, keys: IntArray) -> 'PredictedFeatures':
        """Return the predicted of ``keys``."""
        rows = np.isin(self.warps.ids, keys)
        return PredictedFeatures(self.warps.take(rows), self.unseen[rows])


@dataclass(frozen=True, slots=True, eq=False)
class Motion:
    """Motion between frames: affine map of (u, v, 1), shape (3, 2), and what is left of it."""

    affine: FloatArray
    before: FloatArray
    left: FloatArray

    def applied(self, pixels: FloatArray) -> FloatArray:
        """Return where ``pixels``, shape (N, 2), have moved to."""
        squared = -2.0 * (pixels @ self.before.T)
        squared += (pixels**2).sum(axis=1)[:, None] + ((self.before**2).sum(axis=1) + NEAR_PX**2)
        weight = 1.0 / squared
        near = (weight @ self.left) / weight.sum(axis=1, keepdims=True)
        return np.asarray(_rows(pixels) @ self.affine + near)

    def astray(self, before: FloatArray, after: FloatArray, limit: float) -> BoolArray:
        """Return which of the features moved otherwise than the rest, by more than ``limit``."""
        miss = np.linalg.norm(after - _rows(before) @ self.affine, axis=1)
        return np.asarray(miss > limit + 5.0 * float(np.median(miss)))


def motion_between(before: FloatArray, after: FloatArray) -> Motion | None:
    """Fit the motion of features, shape (N, 2) each; None where they are too few."""
    if len(before) < MIN_SUPPORT:
        return None
    centre = before.mean(axis=0)
    rows, weight = _rows(before - centre), np.ones(len(before))
    for _ in range(ROUNDS):
        weighted = rows.T * (weight * weight)
        affine = np.linalg.solve(weighted @ rows + RIDGE, weighted @ after)
        miss = np.sqrt(((after - rows @ affine) ** 2).sum(axis=1))
        weight = 1.0 / (1.0 + (miss / (2.0 * float(np.median(miss)) + 0.1)) ** 2)
    left: FloatArray = (after - rows @ affine) * weight[:, None]
    affine[2] -= centre @ affine[:2]
    return Motion(np.asarray(affine, dtype=np.float64), before, left)


def _rows(pixels: FloatArray) -> FloatArray:
    return np.column_stack([pixels, np.ones(len(pixels))])
