"""Matcher: keypoints of an image, and the protocol of matchers of whole images."""

from dataclasses import dataclass
from typing import Any, Protocol, runtime_checkable

import numpy as np
from numpy.typing import NDArray

from visual_servo_epipolar.core.arrays import BoolArray, FloatArray, Image, IntArray


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
