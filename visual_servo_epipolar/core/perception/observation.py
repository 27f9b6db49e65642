"""Observations: tracked features as rays, with the distortion of the camera removed."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
import math

import numpy as np

from visual_servo_epipolar.core.arrays import FloatArray
from visual_servo_epipolar.core.geometry.camera import Camera
from visual_servo_epipolar.core.geometry.lens import Lens
from visual_servo_epipolar.core.geometry.motion import HALF_PI
from visual_servo_epipolar.core.tracking.features import Features


@dataclass(frozen=True, slots=True, eq=False)
class Observation:
    """
    One set of matches as rays, shape (N, 2) each, taken at ``stamp_ns``.

    ``focal`` [px] only turns pixel thresholds into angles and back. ``edges`` are the bearings of
    the left and the right edge of the image [rad], right positive.
    """

    stamp_ns: int
    current: FloatArray
    desired: FloatArray
    focal: float
    edges: tuple[float, float] = (-HALF_PI, HALF_PI)

    def __len__(self) -> int:
        return len(self.current)

    def corrected(self, lens: Lens) -> 'Observation':
        """Return the observation without what is wrong with the camera matrix."""
        if lens.corrects_nothing:
            return self
        ratio, shift = math.exp(lens.log_ratio), np.array([lens.shift, 0.0])
        left, right = (math.atan(ratio * math.tan(edge) + lens.shift) for edge in self.edges)
        return replace(
            self,
            current=ratio * self.current + shift,
            desired=ratio * self.desired + shift,
            focal=self.focal / ratio,
            edges=(left, right),
        )


def observe(features: Features, camera: Camera, stamp_ns: int) -> Observation:
    """Back-project tracked features to rays, with the distortion of the camera removed."""
    focal = math.sqrt(camera.fx * camera.fy)
    rays = camera.rays(np.concatenate([features.current, features.desired]))
    rays.flags.writeable = False
    current, desired = rays[: len(features)], rays[len(features) :]
    return Observation(stamp_ns, current, desired, focal, camera.edges)


def observe_each(
    features: Sequence[Features], camera: Camera, stamps_ns: Sequence[int]
) -> list[Observation]:
    """Back-project the features of many views through alike cameras, in one call."""
    if not features:
        return []
    rays = camera.rays(
        np.concatenate([px for view in features for px in (view.current, view.desired)])
    )
    rays.flags.writeable = False
    focal, first, observations = math.sqrt(camera.fx * camera.fy), 0, []
    for view, stamp_ns in zip(features, stamps_ns, strict=True):
        middle, last = first + len(view), first + 2 * len(view)
        pair = rays[first:middle], rays[middle:last]
        observations.append(Observation(stamp_ns, *pair, focal, camera.edges))
        first = last
    return observations
