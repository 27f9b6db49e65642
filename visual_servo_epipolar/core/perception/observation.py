"""Observations: tracked features as rays, with the distortion of the camera removed."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
import math

import numpy as np

from visual_servo_epipolar.core.arrays import FloatArray
from visual_servo_epipolar.core.geometry.camera import Camera, LEAST_FORWARD
from visual_servo_epipolar.core.geometry.lens import corrected, Lens
from visual_servo_epipolar.core.geometry.motion import HALF_PI
from visual_servo_epipolar.core.tracking.features import Features


@dataclass(frozen=True, slots=True, eq=False)
class Observation:
    """
    One set of matches as unit rays, shape (N, 3) each, taken at ``stamp_ns``.

    A feature behind the camera (z < 0) is a ray as any other. ``pixel_angles``, shape (N, 2), are
    the angles of one pixel at each current and desired ray [rad], None for those of a pinhole
    without distortion. ``focal`` [px] only turns pixel thresholds into angles and back. ``edges``
    are the bearings of the left and the right edge of the image [rad], right positive.
    """

    stamp_ns: int
    current: FloatArray
    desired: FloatArray
    focal: float
    edges: tuple[float, float] = (-HALF_PI, HALF_PI)
    pixel_angles: FloatArray | None = None

    @property
    def resolution(self) -> FloatArray:
        """Angle of one pixel at each current and desired ray [rad], shape (N, 2)."""
        if self.pixel_angles is not None:
            return self.pixel_angles
        forward = np.stack([self.current[:, 2], self.desired[:, 2]], axis=1)
        forward = np.maximum(forward, LEAST_FORWARD)
        return np.asarray(forward * np.sqrt(forward) / self.focal)

    def __len__(self) -> int:
        return len(self.current)

    def corrected(self, lens: Lens) -> 'Observation':
        """Return the observation without what is wrong with the camera matrix."""
        if lens.corrects_nothing:
            return self
        ratio = math.exp(lens.log_ratio)
        current, growth_current = corrected(self.current, lens)
        desired, growth_desired = corrected(self.desired, lens)
        left, right = (_corrected_edge(edge, ratio, lens.shift) for edge in self.edges)
        return replace(
            self,
            current=current,
            desired=desired,
            focal=self.focal / ratio,
            edges=(left, right),
            pixel_angles=self.resolution * np.stack([growth_current, growth_desired], axis=1),
        )


def _corrected_edge(edge: float, ratio: float, shift: float) -> float:
    """Return the bearing of an edge of the image [rad], beyond a right angle as well."""
    if abs(edge) >= math.pi:
        return edge
    sine, cosine = math.sin(edge), math.cos(edge)
    return math.atan2(ratio * sine + shift * cosine, cosine)


def observe(features: Features, camera: Camera, stamp_ns: int) -> Observation:
    """Back-project tracked features to rays, with the distortion of the camera removed."""
    rays = _frozen(camera.rays(np.concatenate([features.current, features.desired])))
    return _observation(rays, _frozen(camera.resolution(rays)), camera, stamp_ns)


def observe_each(
    features: Sequence[Features], camera: Camera, stamps_ns: Sequence[int]
) -> list[Observation]:
    """Back-project the features of many views through alike cameras, in one call."""
    if not features:
        return []
    pixels = [columns for view in features for columns in (view.current, view.desired)]
    rays = _frozen(camera.rays(np.concatenate(pixels)))
    resolution = _frozen(camera.resolution(rays))
    observations, first = [], 0
    for view, stamp_ns in zip(features, stamps_ns, strict=True):
        both = slice(first, first + 2 * len(view))
        observations.append(_observation(rays[both], resolution[both], camera, stamp_ns))
        first = both.stop
    return observations


def _observation(
    rays: FloatArray, resolution: FloatArray, camera: Camera, stamp_ns: int
) -> Observation:
    """Return the observation of as many current rays as desired ones, one after the other."""
    count, focal = len(rays) // 2, math.sqrt(camera.fx * camera.fy)
    angles = resolution.reshape(2, count).T.copy()
    return Observation(stamp_ns, rays[:count], rays[count:], focal, camera.edges, angles)


def _frozen(array: FloatArray) -> FloatArray:
    array.flags.writeable = False
    return array
