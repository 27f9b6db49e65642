"""
Two fisheye images in one, as 360-degree cameras give them before they are stitched.

The halves of the image are squares, each the circle of one lens: one looks ahead, one back. No
CameraInfo names them, and none is needed: each lens shows 180 deg over the height of the image.
Their two centres, some centimetres apart, are taken for one: what that does to a ray is the same
in both views of a feature near the goal.
"""

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import partial
import math
from typing import NamedTuple

import numpy as np

from visual_servo_epipolar.core.arrays import as_points, BoolArray, FloatArray
from visual_servo_epipolar.core.cameras.equidistant import Equidistant
from visual_servo_epipolar.core.cameras.intrinsics import ROUND_TRIP_PX

BACK = np.array([-1.0, 1.0, -1.0])  # turns axes of the camera into those of the lens behind
SLACK = 1.0  # of the width by twice the height [px]


class Layout(NamedTuple):
    """Where the lens that looks ahead is, and quarter turns of both images, clockwise."""

    ahead_right: bool
    turns_ahead: int
    turns_back: int


LAYOUTS: Mapping[str, Layout] = {
    'dual_fisheye': Layout(False, 0, 0),
    # As Insta360's driver publishes it: sensors lie on their sides, one on either.
    'dual_fisheye_insta360': Layout(True, 1, 3),
}


@dataclass(frozen=True, slots=True)
class DualFisheye(Equidistant):
    """
    Two fisheye lenses back to back, each imaged by ``Equidistant`` in one half.

    The intrinsics are those of both, in a half that is turned upright. Ahead and back meet at 90
    deg; where a lens sees beyond, a pixel has the ray that its own lens tells.
    """

    distortion_model: str = 'dual_fisheye'

    wide = True
    edges = (-math.inf, math.inf)

    def __post_init__(self) -> None:
        Equidistant.__post_init__(self)
        if abs(self.width - 2 * self.height) > SLACK:
            raise ValueError(
                f'an image of two fisheyes must be twice as wide as high, got '
                f'{self.width}x{self.height} px: a square for each lens; publish both whole, side '
                'by side'
            )

    @property
    def _layout(self) -> Layout:
        return LAYOUTS[self.distortion_model]

    def looks_back(self, pixels: FloatArray) -> BoolArray:
        """See ``TwoLenses``."""
        is_right = pixels[:, 0] > self.height - 0.5
        return np.asarray(is_right != self._layout.ahead_right)

    def rays(self, pixels: FloatArray) -> FloatArray:
        """Return unit rays, (N, 3), of ``pixels``, (N, 2), nan beyond ``reach``."""
        pixels = as_points(pixels, 'pixels')
        back = self.looks_back(pixels)
        rays = Equidistant.rays(self, self._upright(pixels, back))
        rays[back] *= BACK
        return rays

    def pixels(self, rays: FloatArray) -> FloatArray:
        """Return the pixels, (N, 2), of ``rays``, (N, 3), by the lens that looks their way."""
        return self._pixels_by(rays, rays[:, 2] < 0.0)

    def round_trips(self, pixels: FloatArray, rays: FloatArray) -> BoolArray:
        """Return which ``pixels``, shape (N, 2), come back from their ``rays``, (N, 3): (N,)."""
        error = self._pixels_by(rays, self.looks_back(pixels)) - pixels
        return np.asarray(np.hypot(error[:, 0], error[:, 1]) <= ROUND_TRIP_PX)

    def resolution(self, rays: FloatArray) -> FloatArray:
        """Return the angle of a pixel at each of ``rays``, shape (N, 3): (N,) [rad]."""
        ahead = np.column_stack([rays[:, :2], np.abs(rays[:, 2])])
        return Equidistant.resolution(self, ahead)

    def _upright(self, pixels: FloatArray, back: BoolArray) -> FloatArray:
        """Return ``pixels`` in the square of their lens, turned upright."""
        side, layout = self.height - 1.0, self._layout
        right = np.where(pixels[:, 0] > self.height - 0.5, float(self.height), 0.0)
        local = np.column_stack([pixels[:, 0] - right, pixels[:, 1]])
        ahead = _turned(local, -layout.turns_ahead, side)
        return np.where(back[:, None], _turned(local, -layout.turns_back, side), ahead)

    def _pixels_by(self, rays: FloatArray, back: BoolArray) -> FloatArray:
        """Return the pixels of ``rays`` by the lens that looks ahead or ``back``."""
        local = Equidistant.pixels(self, np.where(back[:, None], rays * BACK, rays))
        side, layout = self.height - 1.0, self._layout
        ahead = _turned(local, layout.turns_ahead, side)
        pixels = np.where(back[:, None], _turned(local, layout.turns_back, side), ahead)
        pixels[:, 0] += np.where(back != layout.ahead_right, float(self.height), 0.0)
        return np.asarray(pixels)


def _turned(pixels: FloatArray, quarters: int, side: float) -> FloatArray:
    """Return ``pixels`` of a square with that ``side`` after clockwise ``quarters`` of a turn."""
    u, v = pixels.T
    for _ in range(quarters % 4):
        u, v = side - v, u
    return np.column_stack([u, v])


def of_size(name: str, width: int, height: int) -> DualFisheye:
    """Return the camera of that layout and size [px]; ValueError of what is no pair of squares."""
    focal, centre = height / math.pi, 0.5 * (height - 1)
    return DualFisheye(width, height, focal, focal, centre, centre, (), name)


SIZED: Mapping[str, Callable[[int, int], DualFisheye]] = {
    name: partial(of_size, name) for name in LAYOUTS
}
