"""Localization of one view in the map: its pose, and where the features are."""

from dataclasses import dataclass, field
import math

import numpy as np

from visual_servo_epipolar.core.arrays import BoolArray, FloatArray, IntArray
from visual_servo_epipolar.core.geometry.epipolar import Bearings
from visual_servo_epipolar.core.geometry.motion import wrap_angle
from visual_servo_epipolar.core.geometry.rays import LEAST_FORWARD
from visual_servo_epipolar.core.mapping.factors import LEAST_WAY
from visual_servo_epipolar.core.mapping.fitting import Resection
from visual_servo_epipolar.core.mapping.projection import points_of, Structure, turns_of
from visual_servo_epipolar.core.mapping.refinement import Geometry
from visual_servo_epipolar.core.mapping.window import HEADING, VIEW, X, Y


def _nothing() -> FloatArray:
    return np.full((VIEW, VIEW), np.nan)


@dataclass(frozen=True, eq=False)
class MapLocalization:
    """
    Localization of one view in the map; without one, the ``reason`` why is not empty.

    ``pose``, (5,), is that of the camera in the plane of the photograph's: x (right) and y (ahead)
    [m, as far as the scale is known], heading error (left positive), tilt and roll [rad], with its
    ``covariance``, (5, 5); ``own``, (5, 5), is the part of that which the noise of this view makes
    alone and which averages out over views; ``shift``, (5,), the part of the pose that the
    shrinkage makes. ``inliers``, (N,), are the observations that agree; ``dropped`` the ids of
    wrong matches. Of all features of the map: ``ids``, (M,), ``inverse_depth`` along the
    photograph's rays [1/m] and ``photograph``, (M, 3), those rays. Those ``counted``, (M,), are no
    wrong matches. ``depth`` is the median one [m], ``difference_slope`` that of D at unit focal
    length along the axis [1/m].
    """

    reason: str = ''
    pose: FloatArray = field(default_factory=lambda: np.full(VIEW, np.nan))
    covariance: FloatArray = field(default_factory=_nothing)
    own: FloatArray = field(default_factory=_nothing)
    shift: FloatArray = field(default_factory=lambda: np.zeros(VIEW))
    inliers: BoolArray = field(default_factory=lambda: np.zeros(0, bool))
    dropped: IntArray = field(default_factory=lambda: np.empty(0, np.int64))
    ids: IntArray = field(default_factory=lambda: np.empty(0, np.int64))
    inverse_depth: FloatArray = field(default_factory=lambda: np.empty(0))
    photograph: FloatArray = field(default_factory=lambda: np.empty((0, 3)))
    counted: BoolArray = field(default_factory=lambda: np.zeros(0, bool))
    depth: float = math.nan
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
        """The oriented bearings of the cameras; None without a pose or at the goal."""
        if self.reason or not self.distance > LEAST_WAY:
            return None
        psi = math.atan2(self.pose[Y], self.pose[X])
        phi = psi - float(self.pose[HEADING]) - 0.5 * math.pi
        return Bearings(psi, math.remainder(phi, 2.0 * math.pi))

    @property
    def bearings_covariance(self) -> FloatArray:
        """Covariance of (psi, phi), (2, 2) [rad^2]: without bound towards the goal."""
        x, y = self.lateral, self.longitudinal
        square = max(x * x + y * y, LEAST_WAY**2)
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

    @property
    def parallax(self) -> float:
        """Angle by which the offset moves a feature of median depth [rad]."""
        return self.distance / self.depth


def seen_rays(structure: Structure, pose: FloatArray) -> FloatArray:
    """Return the unit rays, (M, 3), at which a view at ``pose``, (5,), sees features."""
    points = (turns_of(pose[None], structure.stretch) @ points_of(structure, pose[None]))[0]
    return np.asarray((points / np.sqrt((points * points).sum(0))).T)


def localization_of(resection: Resection, geometry: Geometry, known: BoolArray) -> MapLocalization:
    """Return the localization of a view that was resected by the features ``known``, (N,)."""
    inliers = known.copy()
    inliers[known] = resection.inliers
    return MapLocalization(
        pose=resection.pose,
        covariance=resection.covariance,
        own=resection.own,
        shift=resection.shift,
        inliers=inliers,
        dropped=geometry.wrong,
        ids=geometry.window.ids,
        inverse_depth=geometry.unknowns.inverse_depth,
        photograph=geometry.window.photograph,
        counted=geometry.trusted,
        depth=geometry.depth,
    )


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
