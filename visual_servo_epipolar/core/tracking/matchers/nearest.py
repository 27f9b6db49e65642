"""Nearest neighbours among descriptors, from both sides, and by far."""

import numpy as np
from numpy.typing import NDArray

from visual_servo_epipolar.core.arrays import IntArray

RATIO = 0.8  # of the nearest to the second nearest distance (Lowe 2004)
BLOCK = 256  # compared at a time with all of the other image: their distances stay in the cache


def mutual_nearest(
    desired: NDArray[np.float32], current: NDArray[np.float32], *, ratio: float = RATIO
) -> IntArray:
    """
    Return index pairs (desired, current) that are each other's nearest, and by far, (M, 2).

    The nearest is not farther than ``ratio`` of the second nearest, which 1 does not ask for.

    By matrix products: several times as fast as two brute-force matchings. Of whole numbers, as
    SIFT gives them, sums are exact and blocks decide no bit.
    """
    if len(desired) < 2 or len(current) < 2:
        return np.empty((0, 2), np.int64)
    nearest, distinct = np.empty(len(desired), np.int64), np.empty(len(desired), bool)
    least, back = np.full(len(current), np.inf, np.float32), np.zeros(len(current), np.int64)
    twice, lengths = (-2.0 * current).T, np.einsum('nk,nk->n', current, current)
    for first in range(0, len(desired), BLOCK):
        block = desired[first : first + BLOCK]
        squared = block @ twice
        squared += np.einsum('nk,nk->n', block, block)[:, None]
        squared += lengths
        nearer = np.flatnonzero(squared.min(axis=0) < least)
        candidates = squared[:, nearer]
        back[nearer], least[nearer] = first + candidates.argmin(axis=0), candidates.min(axis=0)
        rows = np.arange(len(block))
        nearest[first + rows] = columns = squared.argmin(axis=1)
        best = squared[rows, columns]
        squared[rows, columns] = np.inf
        distinct[first + rows] = best < ratio**2 * squared.min(axis=1)
    mutual = np.flatnonzero(distinct & (back[nearest] == np.arange(len(desired))))
    return np.stack([mutual, nearest[mutual]], axis=1).astype(np.int64)
