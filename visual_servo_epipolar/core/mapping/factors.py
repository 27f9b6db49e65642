"""Factors beside the images: of mount and floor on attitudes, of the lens, and of the scale."""

from dataclasses import dataclass
from functools import cached_property
import math

import numpy as np

from visual_servo_epipolar.core.arrays import FloatArray, ROUNDING
from visual_servo_epipolar.core.mapping.window import (
    KeyframeWindow,
    LENS,
    MapSettings,
    MOUNT,
    PHOTOGRAPH,
    SHARED,
    TILT,
    Unknowns,
    VIEW,
)
from visual_servo_epipolar.core.twoview.estimator import Attitude, LEAST_JITTER

UNKNOWN_SCALE = 1.0  # deviation of the logarithm of an unknown scale
LENS_DEVIATION = 0.03  # of the logarithm of a focal length that somebody measured
LEAST_PLACE = 1e-6  # information of a view that features tell nothing of [1/m^2]


@dataclass(frozen=True, eq=False)
class Factors:
    """
    What is known beside the images.

    ``mount`` is the belief of the camera's attitude: that of each view, and of the photograph,
    differs from it by what the floor does (``mount.jitter``). The scale is one number: the ``way``
    from keyframe to keyframe as commanded or measured [m] against that of the geometry, to
    ``scale_deviation``. Images tell nothing of it, so it tells nothing but itself. The logarithm
    of the focal length is known to ``lens_deviation``.
    """

    mount: Attitude
    views: int
    way: float
    scale_deviation: float
    lens_deviation: float = LENS_DEVIATION

    @property
    def jitter(self) -> float:
        """Deviation of the attitude of a view from the mount's, by what the floor does [rad]."""
        return max(self.mount.jitter, LEAST_JITTER)

    @cached_property
    def information(self) -> FloatArray:
        """Information of all attitudes, (5 K + 5, 5 K + 5), and hardly any of places."""
        size = VIEW * self.views + SHARED
        matrix = LEAST_PLACE * np.eye(size)
        jitter = self.jitter**-2
        attitudes = [*range(TILT, size - SHARED, VIEW), size - SHARED]
        for axis in range(2):
            mount = size - 2 + axis
            each = np.array(attitudes) + axis
            matrix[each, each] = jitter
            matrix[each, mount] = matrix[mount, each] = -jitter
            matrix[mount, mount] = jitter * len(each)
        matrix[-2:, -2:] += np.linalg.inv(self.mount.covariance)
        lens = size - SHARED + LENS
        matrix[lens, lens] = self.lens_deviation**-2
        return matrix

    def _offset(self, unknowns: Unknowns) -> FloatArray:
        """Return how far attitudes are from those of the mount; places count nothing here."""
        mean = np.array([self.mount.tilt, self.mount.roll])
        views, shared = np.zeros((self.views, VIEW)), unknowns.shared.copy()
        views[:, TILT:] = unknowns.views[:, TILT:] - mean
        shared[MOUNT] -= mean
        shared[PHOTOGRAPH] -= mean
        return np.concatenate([views.ravel(), shared])

    def _scale(self, unknowns: Unknowns) -> tuple[float, FloatArray, float]:
        """Return the residual of the scale, the way of each view, and the geometry's whole way."""
        steps = np.diff(unknowns.views[:, :2], axis=0)
        ways = np.hypot(steps[:, 0], steps[:, 1])
        whole = max(float(ways.sum()), ROUNDING)
        expected = self.way if self.way > ROUNDING else whole
        directions = steps / np.maximum(ways, ROUNDING)[:, None]
        return math.log(whole / expected) / self.scale_deviation, directions, whole

    def ratio(self, unknowns: Unknowns) -> float:
        """Return how many times as large the geometry is by the driven way."""
        residual, _, whole = self._scale(unknowns)
        is_known = whole > ROUNDING and math.isfinite(self.scale_deviation)
        return math.exp(-residual * self.scale_deviation) if is_known else 1.0

    def cost(self, unknowns: Unknowns) -> float:
        """Return the sum of squares, in deviations."""
        offset = self._offset(unknowns)
        residual, _, _ = self._scale(unknowns)
        return float(offset @ self.information @ offset) + residual * residual

    def equations(self, unknowns: Unknowns) -> tuple[FloatArray, FloatArray]:
        """Return matrix, (5 K + 5, 5 K + 5), and vector of the normal equations."""
        vector = self.information @ self._offset(unknowns)
        residual, _, _ = self._scale(unknowns)
        slope = self.by_scale(unknowns) / self.scale_deviation
        return self.information + np.outer(slope, slope), vector + residual * slope

    def by_scale(self, unknowns: Unknowns) -> FloatArray:
        """Return the slope of the logarithm of the scale by views and shared unknowns."""
        _, directions, whole = self._scale(unknowns)
        by_view = np.zeros((self.views, VIEW))
        by_view[1:, :2] += directions
        by_view[:-1, :2] -= directions
        return np.concatenate([by_view.ravel(), np.zeros(SHARED)]) / whole


def factors_of(mount: Attitude, window: KeyframeWindow, settings: MapSettings) -> Factors:
    """Return the factors of a ``window``; without a driven way the scale is a guess."""
    way = float(window.ways.sum())
    known = math.isfinite(way) and way > ROUNDING
    lag = settings.lag / way if known else math.inf
    deviation = min(math.hypot(settings.scale_deviation, lag), UNKNOWN_SCALE)
    return Factors(mount, len(window), way if known else 0.0, deviation)


def camera_poses(views: FloatArray) -> FloatArray:
    """Return poses of cameras, (K, 3), forward and left of the photograph's, of ``views``."""
    return np.column_stack([views[:, 1], -views[:, 0], views[:, 2]])


def views_of(cameras: FloatArray, attitude: FloatArray) -> FloatArray:
    """Return views, (K, 5), of camera poses, (K, 3), all at one ``attitude``, (2,) [rad]."""
    places = np.column_stack([-cameras[:, 1], cameras[:, 0], cameras[:, 2]])
    return np.concatenate([places, np.broadcast_to(attitude, (len(cameras), 2))], axis=1)
