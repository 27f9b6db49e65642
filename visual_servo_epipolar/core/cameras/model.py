"""Camera model: turns pixels into rays and back."""

import math
from typing import Protocol

from visual_servo_epipolar.core.arrays import BoolArray, FloatArray


class CameraModel(Protocol):
    """
    A camera: unit rays of pixels, pixels of unit rays, and the margins of its view.

    It has the numbers of camera_info: image size, K [px], and the distortion by its model.
    Pixel coordinates (u, v) are OpenCV's: u right, v down, integers at pixel centres. Camera axes:
    x right, y down, z forward; a lens may see rays behind, z < 0. ``focal`` [px per rad at the
    centre] only turns thresholds in pixels into angles. Equal cameras are equal values. Of an
    image that ``wraps``, u and u + width are one column: pixels must not be subtracted across it.
    """

    def __hash__(self) -> int: ...

    @property
    def width(self) -> int:
        """Width of the image [px]."""

    @property
    def height(self) -> int:
        """Height of the image [px]."""

    @property
    def distortion(self) -> tuple[float, ...]:
        """Coefficients of the lens."""

    @property
    def distortion_model(self) -> str:
        """Name in the registry."""

    @property
    def matrix(self) -> FloatArray:
        """K of CameraInfo, shape (3, 3)."""

    @property
    def fx(self) -> float:
        """Focal length along u."""

    @property
    def fy(self) -> float:
        """Focal length along v."""

    @property
    def cx(self) -> float:
        """Principal point, u."""

    @property
    def cy(self) -> float:
        """Principal point, v."""

    @property
    def skew(self) -> float:
        """Skew: u = fx x + skew y + cx."""

    @property
    def focal(self) -> float:
        """Pixels per rad at the centre."""

    @property
    def lens(self) -> str:
        """Name of the lens, for messages."""

    @property
    def wide(self) -> bool:
        """Whether it sees farther off its axis than an image plane can well hold."""

    @property
    def edges(self) -> tuple[float, float]:
        """
        Bearings of the left and of the right edge of the image [rad], right positive.

        They are -inf and inf of an image that wraps.
        """

    @property
    def wraps(self) -> bool:
        """Whether the left edge of the image is its right one: no turn leads out of view."""

    @property
    def planar(self) -> 'PlanarCamera | None':
        """The camera itself if its image is a plane but for distortion; None for a wider one."""

    def rays(self, pixels: FloatArray) -> FloatArray:
        """Return unit rays, (N, 3), of ``pixels``, (N, 2), not finite where there are none."""

    def pixels(self, rays: FloatArray) -> FloatArray:
        """Return the pixels, shape (N, 2), of ``rays``, shape (N, 3); nan for those not seen."""

    def round_trips(self, pixels: FloatArray, rays: FloatArray) -> BoolArray:
        """
        Return which ``pixels``, shape (N, 2), come back from their ``rays``, (N, 3): (N,).

        A pixel that does not lies where the distortion of the lens cannot be undone.
        """

    def resolution(self, rays: FloatArray) -> FloatArray:
        """
        Return the angle of a pixel at each of ``rays``, shape (N, 3): (N,) [rad].

        It is the square root of its solid angle: the deviation of the angle of a ray, along
        either of two axes across it, where pixels have a deviation of one.
        """

    def contains(self, pixels: FloatArray, *, margin: float = 0.0) -> BoolArray:
        """Return which ``pixels``, shape (N, 2), lie in the image, ``margin`` [px] inside."""


class PlanarCamera(CameraModel, Protocol):
    """A pinhole: all that it sees lies ahead, at an image-plane point (x/z, y/z)."""

    @property
    def distorts(self) -> bool:
        """Whether any distortion coefficient differs from zero."""

    def image_points(self, pixels: FloatArray) -> FloatArray:
        """Return undistorted image-plane points, (N, 2), of ``pixels``, (N, 2)."""

    def pixels_of(self, points: FloatArray) -> FloatArray:
        """Return distorted pixels, (N, 2), of image-plane ``points``, (N, 2)."""


def field_of_view(camera: CameraModel) -> float:
    """Return the angle from the left to the right edge of the image [rad], at most all around."""
    left, right = camera.edges
    return min(right - left, math.tau)
