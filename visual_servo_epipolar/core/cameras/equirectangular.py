"""
Equirectangular image of 360 deg, as drivers of 360-degree cameras publish it.

No CameraInfo names it, and none is needed: all 360 deg lie over the width, as many pixels per rad
along the height, and the horizon in the middle row, unless K of one that was cut has another. Its
left edge is its right one.
"""

from dataclasses import dataclass, replace
import math

import numpy as np

from visual_servo_epipolar.core.arrays import as_points, BoolArray, FloatArray, packed
from visual_servo_epipolar.core.cameras.model import CameraModel

LEAST_LEVEL = 0.3  # cosine of an elevation: nearer to a pole a row is as exact, a column is not
SLACK = 1.0  # of a width by its focal length, and of a height by the width [px]


@dataclass(frozen=True, slots=True)
class Equirectangular(CameraModel):
    """Panorama: u goes with the bearing from -180 to 180 deg, v with the elevation, down."""

    distortion_model: str = 'equirectangular'

    wide = wraps = True
    planar = None
    edges = (-math.inf, math.inf)

    def __post_init__(self) -> None:
        CameraModel.__post_init__(self)  # super() does not know a class with slots
        size = f'{self.width}x{self.height} px'
        if self.height > 0.5 * self.width + SLACK:
            raise ValueError(
                f'an equirectangular image must be at most half as high as wide, got {size}: it '
                'shows 360 deg over its width, 180 at most over its height; crop it, or say which '
                'lens it is'
            )
        span = math.tau * self.fx
        if abs(span - self.width) > SLACK or abs(self.fy - self.fx) > SLACK * self.fx / span:
            raise ValueError(
                f'an equirectangular image must have all 360 deg over its width, got {size} and '
                f'{span:.0f} px around; publish it whole, neither cut nor stretched'
            )
        if max(self.cy, self.height - 1.0 - self.cy) + 0.5 > 0.25 * span + SLACK:
            raise ValueError(
                f'rows of an equirectangular image must lie between the poles, got {size} with '
                f'the horizon in row {self.cy:g}; set K[5] of camera_info to the row of the '
                'horizon, or publish K of the whole image with the crop as region of interest'
            )

    def with_horizon(self, fx: float, cy: float) -> 'Equirectangular':
        """Return the panorama by its own K where it was cut: of another, K tells nothing."""
        is_own = abs(fx - self.fx) * math.tau <= SLACK
        return replace(self, cy=cy) if is_own and self.is_cut else self

    @property
    def is_cut(self) -> bool:
        """Whether rows are missing above and below: which, the size does not tell."""
        return self.height < 0.5 * self.width - SLACK

    def rays(self, pixels: FloatArray) -> FloatArray:
        """Return unit rays, (N, 3), of ``pixels``, (N, 2)."""
        u, v = as_points(pixels, 'pixels').T
        bearing, elevation = (u - self.cx) / self.fx, (v - self.cy) / self.fy
        level = np.cos(elevation)
        return np.column_stack(
            [level * np.sin(bearing), np.sin(elevation), level * np.cos(bearing)]
        )

    def pixels(self, rays: FloatArray) -> FloatArray:
        """Return the pixels, shape (N, 2), of ``rays``, (N, 3): all are seen."""
        level = np.hypot(rays[:, 0], rays[:, 2])
        bearing = np.arctan2(packed(rays[:, 0]), packed(rays[:, 2]))
        elevation = np.arctan2(packed(rays[:, 1]), level)
        return np.column_stack([self.fx * bearing + self.cx, self.fy * elevation + self.cy])

    def round_trips(self, pixels: FloatArray, rays: FloatArray) -> BoolArray:
        """Return which ``pixels``, shape (N, 2), come back from their ``rays``, (N, 3): all."""
        return np.asarray(np.isfinite(rays).all(axis=1))

    def resolution(self, rays: FloatArray) -> FloatArray:
        """Return the angle of a pixel at each of ``rays``, (N, 3): (N,) [rad], bounded."""
        level = np.hypot(rays[:, 0], rays[:, 2])
        return np.asarray(np.sqrt(np.maximum(level, LEAST_LEVEL)) / self.focal)

    def contains(self, pixels: FloatArray, *, margin: float = 0.0) -> BoolArray:
        """Return which ``pixels``, shape (N, 2), lie in the image, which has no sides."""
        u, v = pixels[:, 0], pixels[:, 1]
        beyond = 0.5 - min(margin, 0.0)
        inside_u = (u >= -beyond) & (u <= self.width - 1 + beyond)
        return np.asarray(inside_u & (v >= margin - 0.5) & (v <= self.height - 0.5 - margin))


def of_size(width: int, height: int) -> Equirectangular:
    """Return the panorama of that size [px], which tells all; ValueError of a lower one."""
    focal = width / math.tau
    centre = 0.5 * (width - 1), 0.5 * (height - 1)
    return Equirectangular(width, height, focal, focal, *centre)


def cut_note(camera: object) -> str:
    """Return what is assumed of a ``camera`` that its size alone tells; '' of a whole panorama."""
    if not (isinstance(camera, Equirectangular) and camera.is_cut):
        return ''
    return (
        f'images of {camera.width}x{camera.height} px are taken for panoramas with as many rows '
        'cut above as below; if not, camera_info must have the row of the horizon in K[5]'
    )
