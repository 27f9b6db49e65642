"""Fisheye camera of Kannala and Brandt: the image radius follows the angle."""

from dataclasses import dataclass
from functools import lru_cache
import math

import numpy as np

from visual_servo_epipolar.core.arrays import as_points, FloatArray, packed
from visual_servo_epipolar.core.cameras.model import ANGLES, CameraModel

COEFFICIENTS = (0, 4)
WIDEST = math.radians(170.0)  # from the axis: no lens sees farther, and directions end at 180
WIDE = math.radians(55.0)  # off the axis: the corners of usual pinholes are nearer to it
LEAST_SLOPE = 0.02  # of the radius by the angle: where it is less, a pixel tells no direction
NEWTON_STEPS = 3  # from the table to the last bit


@dataclass(frozen=True, slots=True)
class Equidistant(CameraModel):
    """
    Fisheye lens.

    A ray at theta from the axis is imaged at theta_d = theta (1 + k1 theta^2 + ... + k4 theta^8)
    from the principal point, in focal lengths; ``distortion`` is k1 to k4, or nothing for zeros.
    Rays behind the camera, z < 0, are rays as any other, as far as theta_d grows with theta.
    OpenCV's fisheye functions clamp at 90 deg, and fold what is behind to the other side. No light
    comes from beyond ``circle`` [rad] of the axis, which no camera_info tells.
    """

    distortion_model: str = 'equidistant'
    circle: float = WIDEST

    wraps = False  # its image ends before what is behind it
    planar = None

    def __post_init__(self) -> None:
        CameraModel.__post_init__(self)  # super() does not know a class with slots
        if len(self.distortion) not in COEFFICIENTS:
            raise ValueError(
                f'an equidistant lens must have 4 coefficients, got {len(self.distortion)}; '
                'calibrate it as a fisheye'
            )

    @property
    def wide(self) -> bool:
        """Whether its corners are farther off the axis than 55 deg, as no usual pinhole's are."""
        return _corner(self) > WIDE

    @property
    def reach(self) -> float:
        """Angle from the axis [rad] up to which pixels tell directions."""
        return min(_reach(self.distortion), self.circle)

    @property
    def edges(self) -> tuple[float, float]:
        """Bearings of the left and of the right edge of the image [rad], right positive."""
        return _edges(self)

    def rays(self, pixels: FloatArray) -> FloatArray:
        """Return unit rays, (N, 3), of ``pixels``, (N, 2), nan beyond ``reach``."""
        points = _in_focals(self, as_points(pixels, 'pixels'))
        radius = np.hypot(points[:, 0], points[:, 1])
        theta = _angle(radius, self.distortion, self.reach)
        across = np.divide(np.sin(theta), radius, out=np.ones(len(radius)), where=radius > 0.0)
        return np.column_stack([points * across[:, None], np.cos(theta)])

    def pixels(self, rays: FloatArray) -> FloatArray:
        """Return the pixels, shape (N, 2), of ``rays``, (N, 3); nan for those beyond ``reach``."""
        aside = np.hypot(rays[:, 0], rays[:, 1])
        theta = np.arctan2(aside, packed(rays[:, 2]))
        radius = np.where(theta <= self.reach, _radius(theta, self.distortion), np.nan)
        scale = np.divide(radius, aside, out=np.where(theta == 0.0, 1.0, np.nan), where=aside > 0)
        pixels = rays[:, :2] * scale[:, None] * [self.fx, self.fy] + [self.cx, self.cy]
        return self.sheared(np.asarray(pixels), self.skew)

    def resolution(self, rays: FloatArray) -> FloatArray:
        """
        Return the angle of a pixel at each of ``rays``, shape (N, 3): (N,) [rad].

        The square root of its solid angle, sin(theta) / (fx fy theta_d theta_d'); rays that the
        lens does not see have that of the farthest it does.
        """
        theta = np.arctan2(np.hypot(rays[:, 0], rays[:, 1]), packed(rays[:, 2]))
        theta = np.minimum(theta, self.reach)
        # sin(theta) / theta_d, which is 1 on the axis
        ratio = np.sinc(theta / math.pi) / _growth(theta, self.distortion)
        return np.asarray(np.sqrt(ratio / _slope(theta, self.distortion)) / self.focal)


def _in_focals(camera: Equidistant, pixels: FloatArray) -> FloatArray:
    """Return ``pixels``, (N, 2), from the principal point, in focal lengths, without skew."""
    straight = camera.sheared(pixels, -camera.skew)
    return np.asarray((straight - [camera.cx, camera.cy]) / [camera.fx, camera.fy])


def _growth(theta: FloatArray, distortion: tuple[float, ...]) -> FloatArray:
    """Return theta_d / theta."""
    return np.asarray(np.polynomial.polynomial.polyval(theta * theta, (1.0, *distortion)))


def _radius(theta: FloatArray, distortion: tuple[float, ...]) -> FloatArray:
    """Return theta_d."""
    return np.asarray(theta * _growth(theta, distortion))


def _slope(theta: FloatArray, distortion: tuple[float, ...]) -> FloatArray:
    """Return the derivative of theta_d by theta."""
    powers = (1.0, *(k * (2 * n + 3) for n, k in enumerate(distortion)))
    return np.asarray(np.polynomial.polynomial.polyval(theta * theta, powers))


@lru_cache(maxsize=16)
def _reach(distortion: tuple[float, ...]) -> float:
    """Return the angle up to which theta_d grows with theta, at most WIDEST [rad]."""
    angles = np.linspace(0.0, WIDEST, ANGLES)
    ends = np.flatnonzero(_slope(angles, distortion) < LEAST_SLOPE)
    return float(angles[ends[0] - 1]) if len(ends) else WIDEST


def _angle(radius: FloatArray, distortion: tuple[float, ...], reach: float) -> FloatArray:
    """Invert theta_d = ``radius``: by a table, then Newton's method; nan beyond the ``reach``."""
    angles, radii = _table(distortion, reach)
    within = np.minimum(radius, radii[-1])
    theta = np.interp(within, radii, angles) if any(distortion) else within
    for _ in range(NEWTON_STEPS if any(distortion) else 0):
        theta = theta - (_radius(theta, distortion) - within) / _slope(theta, distortion)
    return np.where(radius <= radii[-1], theta, np.nan)


@lru_cache(maxsize=16)
def _table(distortion: tuple[float, ...], reach: float) -> tuple[FloatArray, FloatArray]:
    """Return angles from the axis to the ``reach`` [rad], and their radii."""
    angles = np.linspace(0.0, reach, ANGLES)
    return angles, _radius(angles, distortion)


@lru_cache(maxsize=16)
def _corner(camera: Equidistant) -> float:
    """Return the angle from the axis of the farthest corner, at most the reach [rad]."""
    ends = [[u, v] for u in (0.0, camera.width - 1.0) for v in (0.0, camera.height - 1.0)]
    corners = _in_focals(camera, np.array(ends))
    farthest = np.hypot(corners[:, 0], corners[:, 1]).max(keepdims=True)
    theta = float(_angle(farthest, camera.distortion, camera.reach)[0])
    return camera.reach if math.isnan(theta) else theta


@lru_cache(maxsize=16)
def _edges(camera: Equidistant) -> tuple[float, float]:
    """Return the bearings of the ends of the middle row, at most the reach [rad]."""
    row = (0.5 * (camera.height - 1) - camera.cy) / camera.fy
    farthest = _radius(np.array([camera.reach]), camera.distortion)[0]
    bearings = []
    for column in (0.0, camera.width - 1.0):
        x = (column - camera.skew * row - camera.cx) / camera.fx
        radius = min(math.hypot(x, row), farthest)
        theta = float(_angle(np.array([radius]), camera.distortion, camera.reach)[0])
        share = math.sin(theta) * x / max(math.hypot(x, row), 1e-12)
        bearings.append(math.atan2(share, math.cos(theta)))
    return bearings[0], bearings[1]
