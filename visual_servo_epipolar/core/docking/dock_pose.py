"""The dock's pose: where the base stood at the photograph, beside where it is now."""

from dataclasses import dataclass
import math

import numpy as np

from visual_servo_epipolar.core.arrays import FloatArray
from visual_servo_epipolar.core.docking.bundle import Solution
from visual_servo_epipolar.core.docking.path_terms import DIFFERENCE
from visual_servo_epipolar.core.docking.planar import composed, inverse
from visual_servo_epipolar.core.docking.unknowns import MOUNT, VIEW


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


def dock_of(solution: Solution, stamp_ns: int) -> DockPose:
    """Return the dock's pose in axes of the base at the last view of a ``solution``."""
    unknowns = solution.unknowns
    last = VIEW * (len(unknowns.views) - 1)
    first_shared = VIEW * len(unknowns.views)
    rows = [last, last + 1, last + 2, *(first_shared + j for j in MOUNT)]
    values = np.concatenate([unknowns.views[-1, :3], unknowns.shared[MOUNT]])
    slopes = np.stack(
        [
            (_dock(values + step) - _dock(values - step)) / (2.0 * DIFFERENCE)
            for step in DIFFERENCE * np.eye(6)
        ],
        axis=1,
    )
    covariance = slopes @ solution.covariance[np.ix_(rows, rows)] @ slopes.T
    ratio = max(solution.noise_ratio, solution.path_ratio, 1.0)
    return DockPose(stamp_ns, _dock(values), ratio**2 * covariance)


def _dock(values: FloatArray) -> FloatArray:
    """Return the dock in the base from camera, (3,), and mount, (3,): M C^-1 M^-1."""
    camera, mount = values[:3], values[3:]
    pose = composed(composed(mount, inverse(camera)), inverse(mount))
    pose[2] = math.remainder(pose[2], 2.0 * math.pi)
    return pose
