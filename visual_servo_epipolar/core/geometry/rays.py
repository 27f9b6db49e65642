"""
Rays: unit vectors from the camera centre, in its axes: x right, y down, z forward.

Any direction is a ray, a feature behind the camera (z < 0) as well. Image-plane points (x/z, y/z)
are what a pinhole makes of rays in front of it; only such cameras have them.
"""

from typing import Any, TypeAlias

import numpy as np

from visual_servo_epipolar.core.arrays import FloatArray

LEAST_FORWARD = 0.2  # z of a ray that has an image-plane point: no pinhole sees beyond 78 deg
SMALLEST = 1e-3  # z that is divided by
NEIGHBOURS, NEAR = 6, 0.3  # of a feature that lie on its surface, and how near they are [rad]


def dot(first: FloatArray, other: FloatArray) -> FloatArray:
    """Return the scalar products of vectors, shape (..., 3) each: (...)."""
    # By components: numpy sums over so short an axis several times slower.
    product = first * other
    return np.asarray(product[..., 0] + product[..., 1] + product[..., 2])


def normalised(vectors: FloatArray) -> FloatArray:
    """Return ``vectors``, shape (..., 3), with unit length."""
    return np.asarray(vectors / np.sqrt(dot(vectors, vectors))[..., None])


def unit_rays(points: FloatArray) -> FloatArray:
    """Return image-plane ``points`` (x/z, y/z), shape (..., N, 2), as rays, shape (..., N, 3)."""
    rays = np.empty((*points.shape[:-1], 3))
    x, y = points[..., 0], points[..., 1]
    np.divide(1.0, np.sqrt(x * x + y * y + 1.0), out=rays[..., 2])
    np.multiply(points, rays[..., 2:], out=rays[..., :2])
    return rays


def image_points(rays: FloatArray) -> FloatArray:
    """Return image-plane points (x/z, y/z), shape (..., N, 2), of ``rays`` in front, z > 0."""
    return np.asarray(rays[..., :2] / rays[..., 2:])


def homogeneous(points: FloatArray) -> FloatArray:
    """Return ``points``, shape (N, 2), with a third coordinate 1, shape (N, 3)."""
    rows = np.ones((len(points), 3))
    rows[:, :2] = points
    return rows


Axes: TypeAlias = tuple[tuple[FloatArray, ...], tuple[FloatArray, ...]]  # x, y, z of two vectors


def tangents(x: FloatArray, y: FloatArray, z: FloatArray) -> Axes:
    """Return two unit vectors across each ray, by components (Duff et al. 2017)."""
    sign = np.copysign(1.0, z)
    a = -1.0 / (sign + z)
    b = x * y * a
    return (1.0 + sign * x * x * a, sign * b, -sign * x), (b, sign + y * y * a, -y)


def image_axes(x: FloatArray, y: FloatArray, z: FloatArray) -> Axes:
    """
    Return how rays of a pinhole move along u and along v, by components, for equal noise in both.

    They are slopes of the ray by its image-plane point, with an area of one between them: the
    farther off the axis, the more unequal. Rays are in front, z > 0.
    """
    root = np.sqrt(np.maximum(z, SMALLEST))
    right = (1.0 - x * x) / root, -x * y / root, -x * z / root
    return right, (-x * y / root, (1.0 - y * y) / root, -y * z / root)


def rotation_level_camera(tilt: Any, roll: Any) -> FloatArray:
    """Return rotations, (..., 3, 3), from camera axes to those of an upright camera: (...)."""
    cos_tilt, sin_tilt, cos_roll, sin_roll = np.cos(tilt), np.sin(tilt), np.cos(roll), np.sin(roll)
    rotations = np.zeros((*np.shape(tilt), 3, 3))
    rotations[..., 0, 0], rotations[..., 0, 1] = cos_roll, -sin_roll
    rotations[..., 1, 0], rotations[..., 1, 1] = cos_tilt * sin_roll, cos_tilt * cos_roll
    rotations[..., 1, 2], rotations[..., 2, 2] = sin_tilt, cos_tilt
    rotations[..., 2, 0], rotations[..., 2, 1] = -sin_tilt * sin_roll, -sin_tilt * cos_roll
    return rotations


def level(
    x: FloatArray, y: FloatArray, z: FloatArray, tilt: Any, roll: Any
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Return rays (x, y, z) in axes of an upright camera; tilt and roll broadcast against them."""
    cos_roll, sin_roll = np.cos(roll), np.sin(roll)
    cos_tilt, sin_tilt = np.cos(tilt), np.sin(tilt)
    rolled = sin_roll * x + cos_roll * y
    return (
        cos_roll * x - sin_roll * y,
        cos_tilt * rolled + sin_tilt * z,
        cos_tilt * z - sin_tilt * rolled,
    )


def handedness(current: FloatArray, desired: FloatArray) -> float:
    """
    Return whether small triangles of matches turn alike in two views: 1 all of them, -1 none.

    Three features of one surface keep their order around wherever an opaque surface is seen from;
    in a mirrored image they turn the other way. Unit rays have shape (N, 3); 0 without triangles.
    """
    nearness = np.minimum(current @ current.T, desired @ desired.T)
    np.fill_diagonal(nearness, -1.0)
    count, least = max(min(NEIGHBOURS, len(current) - 1), 0), np.cos(NEAR)
    near = np.argsort(-nearness, axis=1)[:, :count]
    a, b = np.triu_indices(count, 1)
    corners = np.arange(len(current))[:, None], near[:, a], near[:, b]
    i, j, k = (corner.ravel() for corner in np.broadcast_arrays(*corners))
    is_small = np.minimum(np.minimum(nearness[i, j], nearness[i, k]), nearness[j, k]) > least
    i, j, k = i[is_small], j[is_small], k[is_small]
    turns, wide = [], []
    for rays in (current, desired):
        first, second = rays[j] - rays[i], rays[k] - rays[i]
        turns.append(dot(rays[i], np.cross(first, second)))
        wide.append(dot(first, first) + dot(second, second))
    # A flat triangle tells little: noise turns it.
    weights = np.min(np.abs(turns) / np.maximum(wide, 1e-12), axis=0)
    total = float(weights.sum())
    return float(np.sign(turns[0] * turns[1]) @ weights) / total if total else 0.0
