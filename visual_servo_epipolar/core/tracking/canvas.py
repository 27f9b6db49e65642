"""
Canvas: the image as it is tracked in, and the rays behind its pixels where it is no plane.

An image that wraps is continued beyond its seam on both sides, and beyond its poles, so that flow,
patches and searches find no border there. Between frames each feature is put back where the image
itself shows it. What is far apart is compared by rays: only near each other are pixels a plane.
"""

from dataclasses import dataclass, replace
import math

import numpy as np

from visual_servo_epipolar.core.arrays import BoolArray, FloatArray, Image, ROUNDING
from visual_servo_epipolar.core.cameras.model import CameraModel
from visual_servo_epipolar.core.tracking.robust_geometry import (
    agree_on_one_geometry,
    epipolar_geometry,
)
from visual_servo_epipolar.core.tracking.warps import Warps

BESIDE = 0.1  # of the width, that the image goes on on either side
BEYOND_POLE = 24  # rows


@dataclass(frozen=True, slots=True)
class Canvas:
    """
    Canvas of a ``camera``; None of one whose image is a plane but for distortion.

    Where a camera sees all around by two lenses, ahead and behind, nothing is taken within
    ``band`` [rad] of where their images meet.
    """

    camera: CameraModel | None = None
    band: float = 0.0

    @classmethod
    def of(cls, camera: CameraModel | None, band: float = 0.0) -> 'Canvas':
        """Return the canvas of a camera, unknown ones having planes."""
        if camera is None or camera.planar is not None:
            return cls()
        return cls(camera, band if np.isinf(camera.edges).all() else 0.0)

    @property
    def margins(self) -> tuple[int, int]:
        """How far the image goes on at its sides, and above and below [px]."""
        camera = self.camera
        if camera is None or not camera.wraps:
            return 0, 0
        ends = np.array([[u, v] for v in (-0.5, camera.height - 0.5) for u in (0.0, 0.5)])
        top, _, bottom, _ = rays = camera.rays(ends * [camera.width, 1.0])
        # Whether the ends of two columns are a pole.
        meet = max(np.abs(rays[1] - top).max(), np.abs(rays[3] - bottom).max()) < ROUNDING
        return round(BESIDE * camera.width), BEYOND_POLE if meet else 0

    def painted(self, image: Image) -> Image:
        """Return the canvas of an ``image``, uint8 of shape (H, W)."""
        beside, beyond = self.margins
        if not beside:
            return image
        if beyond:  # over a pole the meridian on the other side goes on
            opposite = np.roll(image, image.shape[1] // 2, axis=1)
            parts = opposite[:beyond][::-1], image, opposite[-beyond:][::-1]
            image = np.concatenate(parts)
        return np.concatenate([image[:, -beside:], image, image[:, :beside]], axis=1)

    def image_of(self, canvas: Image) -> Image:
        """Return the image that a ``canvas`` was painted of."""
        beside, beyond = self.margins
        height, width = canvas.shape
        return canvas[beyond : height - beyond, beside : width - beside]

    def pixels_of_image(self, pixels: FloatArray) -> FloatArray:
        """Return where the image shows ``pixels`` of the canvas, (N, 2), which it owns."""
        margins = self.margins
        return pixels - np.array(margins, float) if margins[0] else pixels

    def pixels_of_canvas(self, pixels: FloatArray) -> FloatArray:
        """Return where the canvas shows ``pixels`` of the image, (N, 2)."""
        margins = self.margins
        return pixels + np.array(margins, float) if margins[0] else pixels

    def owns(self, pixels: FloatArray) -> BoolArray:
        """Return which ``pixels``, shape (N, 2), are the image's own, none shown a second time."""
        beside, beyond = self.margins
        if self.camera is None or not beside:
            return np.ones(len(pixels), bool)
        u, v = (pixels - [beside, beyond]).T + 0.5
        own = (u >= 0.0) & (u < self.camera.width)
        return np.asarray(own & (v >= 0.0) & (v < self.camera.height))

    def shows(self, pixels: FloatArray) -> BoolArray:
        """Return which of its own ``pixels``, (N, 2), are to be gone by, beside none of a seam."""
        if not self.band:
            return np.ones(len(pixels), bool)
        return np.asarray(np.abs(self.points(pixels)[:, 2]) >= math.sin(self.band))

    def own(self, warps: Warps) -> Warps:
        """Return ``warps`` with current pixels put back to where the image itself has them."""
        whole = self.owns(warps.current)
        if self.camera is None or whole.all():
            return warps
        current, over = self._put_back(warps.current)
        affine = warps.affine.copy()
        affine[over, 1] *= -1.0  # south is on the other side of a pole, east is to the right yet
        return replace(warps, current=current, affine=affine)

    def _put_back(self, pixels: FloatArray) -> tuple[FloatArray, BoolArray]:
        """Return own ``pixels``, shape (N, 2), and which lay over a pole, shape (N,)."""
        assert self.camera is not None
        beside, beyond = self.margins
        width, height = self.camera.width, self.camera.height
        u, v = (pixels - [beside, beyond]).T + 0.5
        above, below = (v < 0.0) & bool(beyond), (v >= height) & bool(beyond)
        over = above | below
        v = np.where(above, -v, np.where(below, 2.0 * height - v, v))
        u = (u + 0.5 * width * over) % width
        return np.column_stack([u, v]) - 0.5 + [beside, beyond], np.asarray(over)

    def beside(self, pixels: FloatArray, point: FloatArray) -> FloatArray:
        """Return ``pixels``, (N, 2), each in that of its columns which is nearest to ``point``."""
        if self.camera is None or not self.camera.wraps:
            return pixels
        turns = np.rint((pixels[:, 0] - point[0]) / self.camera.width)
        return np.column_stack([pixels[:, 0] - turns * self.camera.width, pixels[:, 1]])

    def geometry(
        self, current: FloatArray, desired: FloatArray
    ) -> tuple[FloatArray | None, BoolArray]:
        """Return F or E of one robust geometry, (3, 3), and which of the pixels fit it, (N,)."""
        return epipolar_geometry(self.points(current), self.points(desired), self._pixel)

    def agree(self, current: FloatArray, desired: FloatArray) -> bool:
        """Return whether one geometry fits all of the pixels, shape (N, 2) each."""
        return agree_on_one_geometry(self.points(current), self.points(desired), self._pixel)

    @property
    def _pixel(self) -> float:
        """How wide a pixel at the centre is, in units of ``points``."""
        return 1.0 if self.camera is None else 1.0 / self.camera.focal

    def points(self, pixels: FloatArray) -> FloatArray:
        """Return what ``geometry`` is of: ``pixels``, (N, 2), or their rays, (N, 3)."""
        if self.camera is None:
            return pixels
        return self.camera.rays(self.pixels_of_image(pixels))


PLANE = Canvas()
