"""Sources of light: lamps, windows with sky and sun, and the shadows of boxes between."""

from collections.abc import Sequence
from dataclasses import dataclass
import math

import numpy as np

from visual_servo_epipolar.core.arrays import BoolArray, FloatArray

SOFT = 0.05  # of a lamp's size [m^2]: no point is infinitely bright
SKIN = 0.02  # by which a box that casts a shadow is smaller than it looks [m]
PANES = 2  # points along each side of a window that its sky is summed up from
Point = tuple[float, float, float]


@dataclass(frozen=True, eq=False, slots=True)
class Box:
    """A box that casts shadows: its middle, unit axes as rows, and half its size along them."""

    middle: FloatArray
    axes: FloatArray
    half: FloatArray

    def hides(self, points: FloatArray, towards: FloatArray) -> BoolArray:
        """Return which of ``points``, (N, 3), have the box between them and p + ``towards``."""
        start, way = (points - self.middle) @ self.axes.T, towards @ self.axes.T
        way = np.where(np.abs(way) < 1e-9, 1e-9, way)
        half = np.maximum(self.half - SKIN, 1e-3)
        one, two = (-half - start) / way, (half - start) / way
        first, last = np.minimum(one, two).max(axis=1), np.maximum(one, two).min(axis=1)
        return np.asarray((first < last) & (last > 0.0) & (first < 1.0))


def _lit(points: FloatArray, towards: FloatArray, boxes: Sequence[Box]) -> FloatArray:
    """Return 1 for ``points``, shape (N, 3), that see the source, 0 for those in a shadow."""
    ends = np.concatenate([points, points + towards])
    low, high = ends.min(axis=0), ends.max(axis=0)
    hidden = np.zeros(len(points), bool)
    for box in boxes:
        reach = float(np.linalg.norm(box.half))
        if (box.middle + reach > low).all() and (box.middle - reach < high).all():
            hidden |= box.hides(points, towards)
    return np.asarray(~hidden, np.float64)


def _shadowed(
    light: FloatArray, points: FloatArray, towards: FloatArray, boxes: Sequence[Box]
) -> FloatArray:
    """Return ``light`` on ``points``, shape (N,), without what falls into a shadow."""
    bright = np.flatnonzero(light)
    if len(bright):
        light[bright] *= _lit(points[bright], towards[bright], boxes)
    return light


@dataclass(frozen=True, slots=True)
class Lamp:
    """A bulb at ``place`` [m]; ``power`` is what it throws on a surface that faces it 1 m away."""

    place: Point
    power: float

    def on(self, points: FloatArray, normal: FloatArray, boxes: Sequence[Box]) -> FloatArray:
        """Return the light on ``points``, shape (N, 3), of a surface with that unit ``normal``."""
        towards = np.array(self.place) - points
        square = (towards**2).sum(axis=1) + SOFT
        cosines = np.maximum(towards @ normal, 0.0) / np.sqrt(square)
        return _shadowed(self.power * cosines / square, points, towards, boxes)


@dataclass(frozen=True, slots=True)
class Window:
    """
    A window: its middle, its size along the wall and up [m], the unit normal into the room.

    ``sky`` is the light on a surface that saw nothing else; ``sun`` that on a surface across its
    rays, which come from the direction ``sun_from``, where the window lets them through.
    """

    middle: Point
    size: tuple[float, float]
    sky: float
    sun: float = 0.0
    sun_from: Point = (-1.0, -0.5, 0.9)
    normal: Point = (1.0, 0.0, 0.0)

    @property
    def edges(self) -> FloatArray:
        """Its edges to the right, for who looks out, and down [m], shape (2, 3)."""
        x, y, _ = self.normal
        return np.asarray(
            [[-y * self.size[0], x * self.size[0], 0.0], [0.0, 0.0, -self.size[1]]], np.float64
        )

    def on(self, points: FloatArray, normal: FloatArray, boxes: Sequence[Box]) -> FloatArray:
        """Return the light on ``points``, shape (N, 3), of a surface with that unit ``normal``."""
        return self._sky(points, normal, boxes) + self._sun(points, normal, boxes)

    def _sky(self, points: FloatArray, normal: FloatArray, boxes: Sequence[Box]) -> FloatArray:
        share = self.sky * self.size[0] * self.size[1] / PANES**2 / math.pi
        light = np.zeros(len(points))
        for pane in np.ndindex(PANES, PANES):
            place = (np.array(pane) + 0.5) / PANES - 0.5
            towards = np.array(self.middle) + place @ self.edges - points
            square = (towards**2).sum(axis=1) + SOFT
            # Lambert's cosines, on the surface and at the pane
            leaving = np.maximum(-towards @ np.array(self.normal), 0.0)
            cosines = np.maximum(towards @ normal, 0.0) * leaving / square
            light += _shadowed(share * cosines / square, points, towards, boxes)
        return light

    def _sun(self, points: FloatArray, normal: FloatArray, boxes: Sequence[Box]) -> FloatArray:
        rays = np.array(self.sun_from) / np.linalg.norm(self.sun_from)
        cosine = float(normal @ rays)
        if self.sun == 0.0 or cosine <= 0.0:
            return np.zeros(len(points))
        offset, out = np.array(self.middle) - points, np.array(self.normal)
        towards = (offset @ out)[:, None] / (rays @ out) * rays
        along, up = np.abs(((towards - offset) @ self.edges.T) / np.square(self.size)).T
        through = (along < 0.5) & (up < 0.5)
        return _shadowed(np.where(through, self.sun * cosine, 0.0), points, towards, boxes)
