"""The dock's pose: the pose of the base at the photograph, relative to its present one."""

from dataclasses import dataclass
import math

import numpy as np

from visual_servo_epipolar.core.arrays import FloatArray
from visual_servo_epipolar.core.geometry.planar_poses import compose, inverse_pose
from visual_servo_epipolar.core.mapping.adjustment.factors import camera_poses, DIFFERENCE, ON_BASE
from visual_servo_epipolar.core.mapping.adjustment.refinement import Geometry
from visual_servo_epipolar.core.mapping.adjustment.window import HEADING, VIEW


@dataclass(frozen=True, slots=True, eq=False)
class DockPose:
    """
    Pose of the dock in axes of the base at ``stamp_ns``: x forward, y left [m], turn [rad].

    The dock is the base as it stood at the photograph. ``covariance``, (3, 3), is of all three.
    """

    stamp_ns: int
    pose: FloatArray
    covariance: FloatArray

    @property
    def deviation(self) -> float:
        """Deviation of the place along its worst direction [m]."""
        return math.sqrt(max(float(np.linalg.eigvalsh(self.covariance[:2, :2])[-1]), 0.0))

    def turned(self, angle: float) -> FloatArray:
        """Return the covariance in axes in which those of the base are turned by ``angle``."""
        turn = np.eye(3)
        turn[:2, :2] = [[math.cos(angle), -math.sin(angle)], [math.sin(angle), math.cos(angle)]]
        return np.asarray(turn @ self.covariance @ turn.T)

    @property
    def heading_deviation(self) -> float:
        """Deviation of the heading [rad]."""
        return math.sqrt(max(float(self.covariance[2, 2]), 0.0))


def dock_of(geometry: Geometry, noise_ratio: float, stamp_ns: int) -> DockPose:
    """Return the dock's pose at the last view, its covariance grown by the ``noise_ratio``."""
    unknowns, size = geometry.unknowns, geometry.unknowns.views.size
    view = range(size - VIEW, size - VIEW + HEADING + 1)
    rows = [*view, *range(size + ON_BASE.start, size + ON_BASE.stop)]
    values = np.concatenate([unknowns.views[-1, : HEADING + 1], unknowns.shared[ON_BASE]])
    slopes = np.stack(
        [
            (_dock(values + step) - _dock(values - step)) / (2.0 * DIFFERENCE)
            for step in DIFFERENCE * np.eye(6)
        ],
        axis=1,
    )
    root = max(noise_ratio, 1.0) * slopes @ geometry.root[rows]
    return DockPose(stamp_ns, _dock(values), root @ root.T)


def _dock(values: FloatArray) -> FloatArray:
    """Return the dock in the base from view, (3,), and mount, (3,): M C^-1 M^-1."""
    (camera,), mount = camera_poses(values[None, :3]), values[3:]
    pose = compose(compose(mount, inverse_pose(camera)), inverse_pose(mount))
    pose[2] = math.remainder(pose[2], 2.0 * math.pi)
    return pose
