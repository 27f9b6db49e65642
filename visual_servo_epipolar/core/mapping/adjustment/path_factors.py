"""Path factors: the driven path and the mount of the camera, beside images in an adjustment."""

from dataclasses import dataclass, replace
import math

import numpy as np

from visual_servo_epipolar.core.arrays import FloatArray
from visual_servo_epipolar.core.geometry.planar_poses import compose, inverse_pose, relative_pose
from visual_servo_epipolar.core.mapping.adjustment.factors import Factors
from visual_servo_epipolar.core.mapping.adjustment.window import SHARED, Unknowns, VIEW

# Unknowns that all views share, behind those of every adjustment: the camera ahead of the axle and
# to the left [m], its yaw [rad], and the logarithm of the true way over that of the odometry.
MOUNT, SCALE, ADDED = slice(SHARED, SHARED + 3), SHARED + 3, 4
DIFFERENCE = 1e-6  # of numerical derivatives


@dataclass(frozen=True, eq=False, kw_only=True)
class PathFactors(Factors):
    """
    What is known beside the images, with the motion of the base between views.

    ``motions``, (K - 1, 3), are those of the odometry, in axes of the base before, with the roots
    of their information ``weights``, (K - 1, 3, 3). ``prior`` and ``deviations``, (4,), are of the
    unknowns that are added: they make the geometry metric.
    """

    motions: FloatArray
    weights: FloatArray
    prior: FloatArray
    deviations: FloatArray

    def cost(self, unknowns: Unknowns) -> float:
        """Return the sum of squares, in deviations."""
        residuals = self.residuals(unknowns)
        return super().cost(_without_added(unknowns)) + float(residuals @ residuals)

    def equations(self, unknowns: Unknowns) -> tuple[FloatArray, FloatArray]:
        """Return matrix, (5 K + 9, 5 K + 9), and vector of the normal equations."""
        base, pull = super().equations(_without_added(unknowns))
        slopes, residuals = self.slopes(unknowns), self.residuals(unknowns)
        matrix, vector = slopes.T @ slopes, slopes.T @ residuals
        matrix[:-ADDED, :-ADDED] += base
        vector[:-ADDED] += pull
        return matrix, vector

    def path_residuals(self, unknowns: Unknowns) -> FloatArray:
        """Return by how much motions differ from the odometry's, (K - 1, 3), in deviations."""
        poses = camera_poses(unknowns.views)
        apart = _motions(poses[:-1], poses[1:], unknowns.shared) - self.motions
        apart[:, 2] = np.remainder(apart[:, 2] + np.pi, 2.0 * np.pi) - np.pi
        return np.asarray((self.weights @ apart[..., None])[..., 0])

    def path_ratio(self, unknowns: Unknowns) -> float:
        """Return the deviation of the path's residuals over that expected."""
        residuals = self.path_residuals(unknowns)
        return math.sqrt(float((residuals**2).mean())) if residuals.size else 1.0

    def residuals(self, unknowns: Unknowns) -> FloatArray:
        """Return the residuals of the path and of the prior, (3 K + 1,), in deviations."""
        added = (unknowns.shared[SHARED:] - self.prior) / self.deviations
        return np.concatenate([self.path_residuals(unknowns).ravel(), added])

    def slopes(self, unknowns: Unknowns) -> FloatArray:
        """Return the derivatives of the residuals of path and prior, (3 K + 1, 5 K + 9)."""
        poses, shared, count = camera_poses(unknowns.views), unknowns.shared, self.views
        rows = np.zeros((3 * (count - 1) + ADDED, VIEW * count + len(shared)))
        path = rows[:-ADDED].reshape(count - 1, 3, -1)
        first, second = poses[:-1], poses[1:]
        before, pair = _motions(first, second, shared), np.arange(count - 1)

        def slope(motions: FloatArray) -> FloatArray:
            change = (motions - before) / DIFFERENCE
            return np.asarray((self.weights @ change[..., None])[..., 0])

        for j, shift in enumerate(DIFFERENCE * camera_poses(np.eye(3))):
            path[pair, :, VIEW * pair + j] = slope(_motions(first + shift, second, shared))
            path[pair, :, VIEW * (pair + 1) + j] = slope(_motions(first, second + shift, shared))
        for j in range(SHARED, len(shared)):
            other = shared + DIFFERENCE * np.eye(len(shared))[j]
            path[..., VIEW * count + j] = slope(_motions(first, second, other))
        np.fill_diagonal(rows[-ADDED:, -ADDED:], 1.0 / self.deviations)
        return rows


def camera_poses(views: FloatArray) -> FloatArray:
    """Return poses of cameras, (K, 3), forward and left of the photograph's, of ``views``."""
    return np.column_stack([views[:, 1], -views[:, 0], views[:, 2]])


def views_of(cameras: FloatArray, attitude: FloatArray) -> FloatArray:
    """Return views, (K, 5), of camera poses, (K, 3), all at one ``attitude``, (2,) [rad]."""
    places = np.column_stack([-cameras[:, 1], cameras[:, 0], cameras[:, 2]])
    return np.concatenate([places, np.broadcast_to(attitude, (len(cameras), 2))], axis=1)


def _without_added(unknowns: Unknowns) -> Unknowns:
    return replace(unknowns, shared=unknowns.shared[:SHARED])


def _motions(first: FloatArray, second: FloatArray, shared: FloatArray) -> FloatArray:
    """Return the motions of the base from views to others, (K, 3), as odometry would have them."""
    mount = np.broadcast_to(inverse_pose(shared[MOUNT]), first.shape)
    motions = relative_pose(compose(first, mount), compose(second, mount))
    motions[:, :2] *= np.exp(-shared[SCALE])
    return motions
