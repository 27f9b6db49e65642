"""What is tracked at a time: warps with their ages and residuals."""

from dataclasses import dataclass

import numpy as np

from visual_servo_epipolar.core.arrays import BoolArray, FloatArray, IntArray
from visual_servo_epipolar.core.tracking.matching import epipolar_inliers
from visual_servo_epipolar.core.tracking.template_alignment import Warps

MIN_CONSISTENT = 15  # features below which a consistency check says nothing
RESIDUAL_FACTOR, RESIDUAL_FLOOR = 3.0, 2.0  # times the median, plus grey levels


@dataclass(frozen=True, slots=True, eq=False)
class Tracks:
    """What is tracked now; ages [frames] and residuals [grey levels], shape (N,)."""

    warps: Warps
    ages: IntArray
    residuals: FloatArray

    @classmethod
    def nothing(cls) -> 'Tracks':
        """Return no features."""
        empty = np.empty((0, 2))
        return cls.fresh(Warps(np.empty(0, np.int64), empty, empty, np.empty((0, 2, 2))))

    @classmethod
    def fresh(cls, warps: Warps) -> 'Tracks':
        """Return features that were detected just now."""
        return cls(warps, np.zeros(len(warps), np.int64), np.zeros(len(warps)))

    def __len__(self) -> int:
        return len(self.warps)

    def take(self, rows: IntArray | BoolArray) -> 'Tracks':
        """Return the rows chosen by index or mask."""
        return Tracks(self.warps.take(rows), self.ages[rows], self.residuals[rows])

    def joined(self, other: 'Tracks') -> 'Tracks':
        """Return the rows of both."""
        return Tracks(
            self.warps.joined(other.warps),
            np.concatenate([self.ages, other.ages]),
            np.concatenate([self.residuals, other.residuals]),
        )

    def trustworthy(self) -> 'Tracks':
        """
        Drop features whose patch looks much less like the desired one than those of the others.

        Such a patch lies across an edge in depth, and its parts pull in different directions.
        """
        if len(self) < MIN_CONSISTENT:
            return self
        limit = RESIDUAL_FACTOR * float(np.median(self.residuals)) + RESIDUAL_FLOOR
        return self.take(self.residuals <= limit)

    def consistent(self) -> 'Tracks':
        """
        Drop features that contradict the epipolar geometry of the others: mistaken twins.

        Where less than half agree there is no telling who is right, and nothing is dropped.
        """
        if len(self) < MIN_CONSISTENT:
            return self
        agree = epipolar_inliers(self.warps.current, self.warps.desired)
        return self.take(agree) if 2 * int(agree.sum()) >= len(self) else self
