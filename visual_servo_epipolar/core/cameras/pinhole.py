"""The pinhole camera of eq. (1)-(2) with the distortion models of CameraInfo."""

from dataclasses import dataclass
from functools import lru_cache
import math

import cv2
import numpy as np

from visual_servo_epipolar.core.arrays import as_points, BoolArray, FloatArray
from visual_servo_epipolar.core.cameras.model import (
    ANGLES,
    CameraModel,
    PlanarCamera,
    ROUND_TRIP_PX,
)
from visual_servo_epipolar.core.geometry.rays import image_points, LEAST_FORWARD, unit_rays

STEP = 1e-5  # on the image plane, that the slope of the distortion is taken over
FARTHEST = math.radians(89.0)  # from the axis, that the distortion is followed to
# Of a rational_polynomial 12 have thin prisms as well, 14 also a tilted sensor.
DISTORTION_MODELS = {
    '': (0,),
    'plumb_bob': (0, 4, 5),
    'rational_polynomial': (0, 8, 12, 14),
}


@dataclass(frozen=True, slots=True)
class Camera(PlanarCamera):
    """
    Pinhole camera with the distortion models of CameraInfo.

    ``rays`` and ``pixels`` speak of directions, unit vectors (x, y, z), as those of every camera
    do; ``image_points`` and ``pixels_of`` of image-plane points (x/z, y/z), which only a pinhole
    has.
    """

    distortion_model: str = 'plumb_bob'

    def __post_init__(self) -> None:
        CameraModel.__post_init__(self)  # super() does not know a class with slots
        allowed = DISTORTION_MODELS.get(self.distortion_model)
        if allowed is None or len(self.distortion) not in allowed:
            raise ValueError(
                'distortion must be plumb_bob (4 or 5 numbers), rational_polynomial (8, 12 or 14) '
                f'or equidistant (4), got {self.distortion_model!r:.40} with '
                f'{len(self.distortion)}; rectify the images first'
            )

    @property
    def lens(self) -> str:
        """Name of the lens, for messages."""
        return self.distortion_model if self.distorts else 'pinhole'

    @property
    def edges(self) -> tuple[float, float]:
        """Bearings of the left and of the right edge of the image [rad], right positive."""
        return _edges(self)

    def image_points(self, pixels: FloatArray) -> FloatArray:
        """
        Back-project ``pixels``, shape (N, 2), to image-plane points (x/z, y/z), undistorted.

        Raises
        ------
        ValueError
            If ``pixels`` has another shape or holds NaN.

        """
        points = self.sheared(as_points(pixels, 'pixels'), -self.skew)
        if self.distorts and len(points):
            return _undistort(points, self.matrix, np.array(self.distortion))
        return np.asarray((points - [self.cx, self.cy]) / [self.fx, self.fy])

    def pixels_of(self, points: FloatArray) -> FloatArray:
        """Project image-plane points (x/z, y/z), shape (N, 2), to distorted pixels, (N, 2)."""
        points = as_points(points, 'points')
        if self.distorts and len(points):
            vectors = np.column_stack([points, np.ones(len(points))]).reshape(-1, 1, 3)
            projected, _ = cv2.projectPoints(
                vectors, np.zeros(3), np.zeros(3), self.matrix, np.array(self.distortion)
            )
            pixels = np.asarray(projected, dtype=np.float64).reshape(-1, 2)
        else:
            pixels = points * [self.fx, self.fy] + [self.cx, self.cy]
        return self.sheared(pixels, self.skew)  # which OpenCV's functions leave out

    def rays(self, pixels: FloatArray) -> FloatArray:
        """Return the directions, unit vectors of shape (N, 3), that ``pixels``, (N, 2), show."""
        return unit_rays(self.image_points(pixels))

    def pixels(self, rays: FloatArray) -> FloatArray:
        """Return the pixels, shape (N, 2), of ``rays``, shape (N, 3); nan for those behind."""
        pixels = np.full((len(rays), 2), np.nan)
        front = rays[:, 2] > 0.0
        pixels[front] = self.pixels_of(image_points(rays[front]))
        return pixels

    def round_trips(self, pixels: FloatArray, rays: FloatArray) -> BoolArray:
        """Return which ``pixels``, shape (N, 2), come back from their ``rays``, (N, 3): (N,)."""
        whole = np.asarray(np.isfinite(rays).all(axis=1))
        if not self.distorts or not whole.any():
            return whole
        error = np.full((len(rays), 2), np.nan)
        error[whole] = self.pixels(rays[whole]) - pixels[whole]
        aside = np.hypot(rays[:, 0], rays[:, 1]) <= _farthest(self) * rays[:, 2]
        return np.asarray(aside & (np.hypot(error[:, 0], error[:, 1]) <= ROUND_TRIP_PX))

    def resolution(self, rays: FloatArray) -> FloatArray:
        """Return the angle of a pixel at each of ``rays``, shape (N, 3): (N,) [rad]."""
        forward = np.maximum(rays[:, 2], LEAST_FORWARD)
        resolution = np.asarray(forward * np.sqrt(forward) / math.sqrt(self.fx * self.fy))
        if not self.distorts or not len(rays):
            return resolution
        points, step = rays[:, :2] / forward[:, None], STEP
        right, down = (
            (self.pixels_of(points + move) - self.pixels_of(points - move)) / (2.0 * step)
            for move in ([step, 0.0], [0.0, step])
        )
        area = right[:, 0] * down[:, 1] - right[:, 1] * down[:, 0]  # of a pixel, without: fx fy
        return np.asarray(resolution * np.sqrt(self.fx * self.fy / np.abs(area)))


def _undistort(pixels: FloatArray, matrix: FloatArray, distortion: FloatArray) -> FloatArray:
    """Iterate to 1e-12: OpenCV's default of five iterations leaves 0.1 px at the corners."""
    criteria = (cv2.TERM_CRITERIA_COUNT + cv2.TERM_CRITERIA_EPS, 100, 1e-12)
    pixels = pixels.reshape(-1, 1, 2)
    if hasattr(cv2, 'undistortPointsIter'):  # OpenCV 4; 5 has one function for both
        points = cv2.undistortPointsIter(pixels, matrix, distortion, None, None, criteria)
    else:
        points = cv2.undistortPoints(pixels, matrix, distortion, criteria=criteria)
    return np.asarray(points, dtype=np.float64).reshape(-1, 2)


@lru_cache(maxsize=16)
def _farthest(camera: Camera) -> float:
    """Return how far from the axis the radius in the image grows: farther out it folds back."""
    k1, k2, _, _, k3, k4, k5, k6 = (*camera.distortion, 0.0, 0.0, 0.0, 0.0)[:8]
    radii = np.tan(np.linspace(0.0, FARTHEST, ANGLES))
    s = radii * radii
    below = 1.0 + s * (k4 + s * (k5 + s * k6))
    with np.errstate(divide='ignore', invalid='ignore'):
        distorted = radii * (1.0 + s * (k1 + s * (k2 + s * k3))) / below
    ends = np.flatnonzero(~((np.diff(distorted) > 0.0) & (below[1:] > 0.0)))
    return float(radii[ends[0]]) if len(ends) else math.inf


@lru_cache(maxsize=16)
def _edges(camera: Camera) -> tuple[float, float]:
    middle = 0.5 * (camera.height - 1)
    (left, _), (right, _) = camera.image_points(
        np.array([[0.0, middle], [camera.width - 1.0, middle]])
    )
    return math.atan(left), math.atan(right)
