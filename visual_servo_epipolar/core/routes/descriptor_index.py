"""
Index of the descriptors of many photographs: which of them are nearest to those of an image.

Of some thousand photographs a matrix product compares all with all. Beyond ``MANY`` descriptors an
inverted file of faiss (extra ``places``) compares each with those of its own neighbourhood alone.
"""

from functools import cached_property
from importlib import import_module
import math
from typing import Any

import numpy as np
from numpy.typing import NDArray

from visual_servo_epipolar.core.arrays import FloatArray, IntArray

MANY = 300_000  # descriptors, some 3000 photographs: a product with them takes a second
NEAREST = 64  # descriptors that are looked at of each: more than show one place
PROBED = 8  # cells of the index that are searched; of N descriptors it has the root of N
LEARNT_FROM, ROUNDS = 40, 5  # descriptors of each cell, and how often its middle is moved


class DescriptorIndex:
    """
    Index of ``descriptors``, float32 of shape (N, K), equal in norm, of photographs ``owners``.

    Both are in the order of the photographs; ``owners``, (N,), are their numbers.
    """

    def __init__(self, descriptors: NDArray[np.float32], owners: IntArray) -> None:
        self._descriptors, self._owners = descriptors, owners

    def nearest(
        self, descriptors: NDArray[np.float32], among: IntArray
    ) -> tuple[IntArray, FloatArray]:
        """
        Return photographs, (M, n), and the largest product of each with ``descriptors``, (M, K).

        A photograph may stand there more than once, with a smaller product; -inf is none. Only
        those ``among`` these numbers count, in ascending order.
        """
        count = int(self._owners[-1]) + 1 if len(self._owners) else 0
        if len(among) == count and self._inverted_file is not None:
            products, rows = self._inverted_file.search(np.ascontiguousarray(descriptors), NEAREST)
            return self._owners[rows], np.where(rows < 0, -np.inf, products)
        best = [self._best(descriptors, number) for number in among.tolist()]
        return np.broadcast_to(among, (len(descriptors), len(among))), np.stack(best, axis=1)

    def _best(self, descriptors: NDArray[np.float32], number: int) -> FloatArray:
        """Return the largest product with one of the photograph's, (M,)."""
        first, last = np.searchsorted(self._owners, [number, number + 1])
        if first == last:
            return np.full(len(descriptors), -np.inf)
        return np.asarray((descriptors @ self._descriptors[first:last].T).max(axis=1))

    @cached_property
    def _inverted_file(self) -> Any | None:
        """The index of faiss; None of few descriptors, or where faiss is not installed."""
        if len(self._descriptors) < MANY:
            return None
        try:
            faiss = import_module('faiss')
        except ImportError:
            return None
        width, cells = self._descriptors.shape[1], math.isqrt(len(self._descriptors))
        coarse = faiss.IndexFlatIP(width)
        index = faiss.IndexIVFFlat(coarse, width, cells, faiss.METRIC_INNER_PRODUCT)
        index.cp.niter = ROUNDS
        few = self._descriptors[:: max(len(self._descriptors) // (LEARNT_FROM * cells), 1)]
        index.train(np.ascontiguousarray(few))
        index.add(self._descriptors)
        index.nprobe = PROBED
        return index
