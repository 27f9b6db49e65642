"""Camera model: K as calibrations and CameraInfo write it; turns pixels into rays and back."""

from abc import ABC, abstractmethod
from dataclasses import dataclass
import math

import numpy as np

from visual_servo_epipolar.core.arrays import BoolArray, FloatArray

ANGLES = 4096  # off the axis, of a table of a lens, or tried for where it folds
ROUND_TRIP_PX = 0.1  # that a pixel may be off where it comes back: half of what tracking is


@dataclass(frozen=True, slots=True)
class CameraModel(ABC):
    """
    A camera: unit rays of pixels, pixels of unit rays, and the margins of its view.

    It has the numbers of camera_info: image size, focal lengths and principal point [px],
    ``distortion`` by the model of that name in the registry; ``skew`` s is K[1]: u = fx x + s y +
    cx [px], behind the distortion. Pixel coordinates (u, v) are OpenCV's: u right, v down,
    integers at pixel centres. Camera axes: x right, y down, z forward; a lens may see rays behind,
    z < 0. Equal cameras are equal values.
    """

    width: int
    height: int
    fx: float
    fy: float
    cx: float
    cy: float
    distortion: tuple[float, ...] = ()
    distortion_model: str = ''
    skew: float = 0.0

    def __post_init__(self) -> None:
        if min(self.width, self.height) < 1:
            raise ValueError(
                f'image size must be positive, got {self.width}x{self.height}; '
                'check width and height of the CameraInfo'
            )
        intrinsics = (self.fx, self.fy, self.cx, self.cy, self.skew, *self.distortion)
        if not all(math.isfinite(value) for value in intrinsics):
            raise ValueError(f'intrinsics must be finite, got {intrinsics}; calibrate the camera')
        if min(self.fx, self.fy) <= 0.0:
            raise ValueError(
                f'focal lengths must be positive, got fx {self.fx} and fy {self.fy} px: '
                'K[0] = 0 means an uncalibrated camera; calibrate it and set its CameraInfo'
            )

    @property
    def matrix(self) -> FloatArray:
        """K as in CameraInfo, shape (3, 3): the intrinsic matrix of a pinhole (eq. 2)."""
        return np.array([[self.fx, self.skew, self.cx], [0.0, self.fy, self.cy], [0.0, 0.0, 1.0]])

    @property
    def lens(self) -> str:
        """Name of the lens, for messages."""
        return self.distortion_model

    @property
    def focal(self) -> float:
        """Pixels per rad at the centre, which only turns thresholds in pixels into angles."""
        return math.sqrt(self.fx * self.fy)

    @property
    @abstractmethod
    def wide(self) -> bool:
        """Whether it sees farther off its axis than an image plane can well hold."""

    @property
    @abstractmethod
    def wraps(self) -> bool:
        """
        Whether the left edge of the image is its right one: no turn leads out of view.

        Then u and u + width are one column: pixels must not be subtracted across it.
        """

    @property
    @abstractmethod
    def edges(self) -> tuple[float, float]:
        """
        Bearings of the left and of the right edge of the image [rad], right positive.

        They are -inf and inf of an image that wraps.
        """

    @property
    @abstractmethod
    def planar(self) -> 'PlanarCamera | None':
        """The camera itself if its image is a plane but for distortion; None for a wider one."""

    @abstractmethod
    def rays(self, pixels: FloatArray) -> FloatArray:
        """Return unit rays, (N, 3), of ``pixels``, (N, 2), not finite where there are none."""

    @abstractmethod
    def pixels(self, rays: FloatArray) -> FloatArray:
        """Return the pixels, shape (N, 2), of ``rays``, shape (N, 3); nan for those not seen."""

    @abstractmethod
    def resolution(self, rays: FloatArray) -> FloatArray:
        """
        Return the angle of a pixel at each of ``rays``, shape (N, 3): (N,) [rad].

        It is the square root of its solid angle: the deviation of the angle of a ray, along
        either of two axes across it, where pixels have a deviation of one. Rays that the lens does
        not see have that of the farthest it does.
        """

    def round_trips(self, pixels: FloatArray, rays: FloatArray) -> BoolArray:
        """
        Return which ``pixels``, shape (N, 2), come back from their ``rays``, (N, 3): (N,).

        A pixel that does not lies where the distortion of the lens cannot be undone.
        """
        error = self.pixels(rays) - pixels
        return np.asarray(np.hypot(error[:, 0], error[:, 1]) <= ROUND_TRIP_PX)

    def contains(self, pixels: FloatArray, *, margin: float = 0.0) -> BoolArray:
        """Return which ``pixels``, shape (N, 2), lie in the image, ``margin`` [px] inside."""
        u, v = pixels[:, 0], pixels[:, 1]
        inside_u = (u >= margin) & (u <= self.width - 1 - margin)
        return np.asarray(inside_u & (v >= margin) & (v <= self.height - 1 - margin))

    def sheared(self, pixels: FloatArray, skew: float) -> FloatArray:
        """Return ``pixels``, shape (N, 2), with a ``skew`` [px]: its own, or the opposite."""
        if skew == 0.0:
            return pixels
        u, v = pixels[:, 0], pixels[:, 1]
        return np.column_stack([u + (v - self.cy) * (skew / self.fy), v])


class PlanarCamera(CameraModel):
    """A pinhole: all that it sees lies ahead, at an image-plane point (x/z, y/z)."""

    __slots__ = ()
    wide = wraps = False  # its image is a plane

    @property
    def planar(self) -> 'PlanarCamera':
        """The camera itself: its image is a plane."""
        return self

    @property
    def distorts(self) -> bool:
        """Whether any distortion coefficient differs from zero."""
        return any(self.distortion)

    @abstractmethod
    def image_points(self, pixels: FloatArray) -> FloatArray:
        """Return undistorted image-plane points, (N, 2), of ``pixels``, (N, 2)."""

    @abstractmethod
    def pixels_of(self, points: FloatArray) -> FloatArray:
        """Return distorted pixels, (N, 2), of image-plane ``points``, (N, 2)."""


def field_of_view(camera: CameraModel) -> float:
    """Return the angle from the left to the right edge of the image [rad], at most all around."""
    left, right = camera.edges
    return min(right - left, math.tau)
