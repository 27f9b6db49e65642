"""Warps: affine maps from the desired to the current image, one for each feature."""

from dataclasses import dataclass

import numpy as np

from visual_servo_epipolar.core.arrays import BoolArray, FloatArray, IntArray


@dataclass(frozen=True, slots=True, eq=False)
class Warps:
    """
    Affine warps from the desired to the current image, rows are features.

    The point ``desired`` + xi appears at ``current`` + ``affine`` xi [px]. ``ids``, shape (N,);
    ``desired`` and ``current``, shape (N, 2); ``affine``, shape (N, 2, 2).
    """

    ids: IntArray
    desired: FloatArray
    current: FloatArray
    affine: FloatArray

    @classmethod
    def empty(cls) -> 'Warps':
        """Return the warps of no feature."""
        pixels = np.empty((0, 2))
        return cls(np.empty(0, np.int64), pixels, pixels, np.empty((0, 2, 2)))

    def __len__(self) -> int:
        return len(self.ids)

    def take(self, rows: IntArray | BoolArray) -> 'Warps':
        """Return the rows chosen by index, shape (M,), or mask, shape (N,)."""
        return Warps(self.ids[rows], self.desired[rows], self.current[rows], self.affine[rows])

    def joined(self, more: 'Warps') -> 'Warps':
        """Return these warps followed by ``more``."""
        return Warps(
            np.concatenate([self.ids, more.ids]),
            np.concatenate([self.desired, more.desired]),
            np.concatenate([self.current, more.current]),
            np.concatenate([self.affine, more.affine]),
        )


def squared_lengths(vectors: FloatArray) -> FloatArray:
    """Return the squared lengths, (N,), of ``vectors``, (N, 2): a third of the time of a sum."""
    squares = vectors * vectors
    return np.asarray(squares[:, 0] + squares[:, 1])
