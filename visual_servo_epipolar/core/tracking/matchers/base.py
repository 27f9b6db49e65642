"""Matcher: keypoints of an image, the protocol of matchers of whole images, nearest neighbours."""

from dataclasses import dataclass
from typing import Any, Protocol, runtime_checkable

import numpy as np
from numpy.typing import NDArray

from visual_servo_epipolar.core.arrays import BoolArray, FloatArray, Image, IntArray

RATIO = 0.8  # of the nearest to the second nearest distance (Lowe 2004)
NEIGHBOURS = 8  # nearest matches, by which one is judged
BLOCK = 256  # compared at a time with all of the other image: their distances stay in the cache


@dataclass(frozen=True, slots=True, eq=False)
class Keypoints:
    """
    Keypoints of one image.

    ``pixels``, shape (N, 2); ``sizes``, shape (N,), diameters [px]; ``angles``, shape (N,), of
    the steepest gradient [rad]; ``descriptors``, shape (N, K). A matcher without sizes or
    angles gives ones and zeros. ``tuning`` is how they were detected, for the matcher alone.
    """

    pixels: FloatArray
    sizes: FloatArray
    angles: FloatArray
    descriptors: NDArray[Any]
    tuning: object = None

    @classmethod
    def empty(cls) -> 'Keypoints':
        """Return no keypoint."""
        return cls(np.empty((0, 2)), np.empty(0), np.empty(0), np.empty((0, 1), np.float32))

    def __len__(self) -> int:
        return len(self.pixels)

    def take(self, rows: IntArray | BoolArray) -> 'Keypoints':
        """Return the rows chosen by index, shape (M,), or mask, shape (N,)."""
        return Keypoints(
            self.pixels[rows],
            self.sizes[rows],
            self.angles[rows],
            self.descriptors[rows],
            self.tuning,
        )


@runtime_checkable
class Matcher(Protocol):
    """
    Matcher: finds the points of a photograph in an image that may look quite different.

    Images are uint8, shape (H, W), at most ``limit`` keypoints are wanted of each. Its methods
    are deterministic and never raise for what an image shows. Wrong pairs are expected: the caller
    keeps those that agree on one epipolar geometry.
    """

    def describe(self, image: Image, *, limit: int, border: float) -> Keypoints:
        """Return keypoints of the photograph; nearer to its border [px] they are not used."""

    def detect(self, image: Image, tuning: object, *, limit: int, quick: bool) -> Keypoints:
        """
        Return keypoints of a current image, to be paired with photographs of that ``tuning``.

        ``quick`` asks for fewer in a fraction of the time; implementations may ignore it.
        """

    def pairs(self, desired: Keypoints, current: Keypoints) -> IntArray:
        """Return index pairs (desired, current) of what may be the same points, shape (M, 2)."""


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
