"""Localization of one view in the map: its pose, and where the features are."""

from dataclasses import dataclass
import math

import numpy as np

from visual_servo_epipolar.core.arrays import BoolArray, FloatArray, ROUNDING
from visual_servo_epipolar.core.geometry.epipolar import Bearings
from visual_servo_epipolar.core.geometry.motion import wrap_angle
from visual_servo_epipolar.core.geometry.rays import LEAST_FORWARD
from visual_servo_epipolar.core.mapping.projection import points_of, Structure, turns_of
from visual_servo_epipolar.core.mapping.refinement import Geometry
from visual_servo_epipolar.core.mapping.window import HEADING, X, Y


@dataclass(frozen=True, eq=False)
class MapLocalization:
    """
    Localization of one view in the map.

    ``pose``, (5,), is that of the camera in the plane of the photograph's: x (right) and y (ahead)
    [m, as far as the scale is known], heading error (left positive), tilt and roll [rad], with its
    ``covariance``, (5, 5); ``own``, (5, 5), is the part of that which the noise of this view makes
    alone and which averages out over views; ``shift``, (5,), the part of the pose that the
    shrinkage makes. ``inliers``, (N,), are the observations that agree; ``geometry`` is that of
    the map, ``difference_slope`` that of D at unit focal length along the axis [1/m].
    """

    pose: FloatArray
    covariance: FloatArray
    own: FloatArray
    geometry: Geometry
    inliers: BoolArray
    shift: FloatArray
    difference_slope: float = math.nan

    @property
    def distance(self) -> float:
        """Distance of the cameras [m]."""
        return float(np.hypot(self.pose[X], self.pose[Y]))

    @property
    def lateral(self) -> float:
        """Offset to the right [m]."""
        return float(self.pose[X])

    @property
    def longitudinal(self) -> float:
        """Offset ahead [m]."""
        return float(self.pose[Y])

    @property
    def heading_error(self) -> float:
        """Heading error, left positive [rad]."""
        return wrap_angle(float(self.pose[HEADING]))

    @property
    def difference(self) -> float:
        """D at unit focal length, as the offset makes it."""
        return self.difference_slope * self.longitudinal

    @property
    def bearings(self) -> Bearings | None:
        """The oriented bearings of the cameras; None at the goal."""
        if not self.distance > ROUNDING:
            return None
        psi = math.atan2(self.pose[Y], self.pose[X])
        phi = psi - float(self.pose[HEADING]) - 0.5 * math.pi
        return Bearings(psi, math.remainder(phi, 2.0 * math.pi))

    @property
    def bearings_covariance(self) -> FloatArray:
        """Covariance of (psi, phi), (2, 2) [rad^2]: without bound towards the goal."""
        x, y = self.lateral, self.longitudinal
        square = max(x * x + y * y, ROUNDING**2)
        right, ahead = -y / square, x / square
        slope = np.array([[right, ahead, 0.0], [right, ahead, -1.0]])
        return np.asarray(slope @ self.covariance[:3, :3] @ slope.T)

    @property
    def bearings_deviation(self) -> float:
        """Deviation of the bearing that is known less well [rad]."""
        return math.sqrt(float(self.bearings_covariance.diagonal().max()))

    @property
    def lateral_deviation(self) -> float:
        """Deviation of the lateral offset x [m]."""
        return math.sqrt(self.covariance[X, X])

    @property
    def longitudinal_deviation(self) -> float:
        """Deviation of the longitudinal offset y [m]."""
        return math.sqrt(self.covariance[Y, Y])

    @property
    def heading_deviation(self) -> float:
        """Deviation of the heading error [rad]."""
        return math.sqrt(self.covariance[HEADING, HEADING])


def seen_rays(structure: Structure, pose: FloatArray) -> FloatArray:
    """Return the unit rays, (M, 3), at which a view at ``pose``, (5,), sees features."""
    points = (turns_of(pose[None], structure.stretch) @ points_of(structure, pose[None]))[0]
    return np.asarray((points / np.sqrt((points * points).sum(0))).T)


def difference_slope(
    desired: FloatArray, inverse_depth: FloatArray, *, wide: bool = False
) -> float:
    """Return dD/dy at the goal [1/m], averaged over features ahead: positive past the goal."""
    z = desired[:, 2]
    square = 1.0 - z * z
    if wide:  # D counts 2 (1 - z)
        return float(np.mean(2.0 * square * inverse_depth)) if len(z) else math.nan
    ahead = z > LEAST_FORWARD
    if not ahead.any():
        return math.nan
    # |p|^2 = (X^2 + Y^2) / (Z - y)^2 grows by 2 |p|^2 / Z, and Z = z / nearness.
    return float(np.mean(2.0 * square[ahead] * inverse_depth[ahead] / z[ahead] ** 3))
