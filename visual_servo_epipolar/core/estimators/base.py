"""What every estimator takes and gives."""

from dataclasses import dataclass
from typing import Protocol

import numpy as np

from visual_servo_epipolar.core.arrays import BoolArray, FloatArray
from visual_servo_epipolar.core.epipolar import Bearings


@dataclass(frozen=True, slots=True, eq=False)
class Estimate:
    """
    Epipolar geometry of one pair of views, at unit focal length.

    ``inliers`` has shape (N,); ``fundamental`` is for rays; ``confidence`` of the cheirality vote
    runs from 0 to 1.
    """

    bearings: Bearings
    fundamental: FloatArray
    inliers: BoolArray
    confidence: float


class Estimator(Protocol):
    """Matches in, bearings out; random choices come from ``rng`` alone."""

    def __call__(
        self,
        current: FloatArray,
        desired: FloatArray,
        *,
        noise: float,
        rng: np.random.Generator,
    ) -> Estimate:
        """
        Estimate from rays, shape (N, 2) each, with coordinate noise ``noise``.

        Raises DegenerateGeometryError when the matches cannot answer.
        """
        ...
