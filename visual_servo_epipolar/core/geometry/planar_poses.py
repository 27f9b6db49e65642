"""
Poses in the plane as arrays, shape (..., 3): x forward, y left [m], and turn to the left [rad].

``T_a_b`` is the pose of b in a, by REP 103.
"""

import numpy as np

from visual_servo_epipolar.core.arrays import FloatArray
from visual_servo_epipolar.core.geometry.epipolar import Bearings


def compose(T_a_b: FloatArray, T_b_c: FloatArray) -> FloatArray:
    """Return T_a_c."""
    cosine, sine = np.cos(T_a_b[..., 2]), np.sin(T_a_b[..., 2])
    x, y = T_b_c[..., 0], T_b_c[..., 1]
    return np.stack(
        [
            T_a_b[..., 0] + cosine * x - sine * y,
            T_a_b[..., 1] + sine * x + cosine * y,
            T_a_b[..., 2] + T_b_c[..., 2],
        ],
        axis=-1,
    )


def inverse_pose(T_a_b: FloatArray) -> FloatArray:
    """Return T_b_a."""
    cosine, sine = np.cos(T_a_b[..., 2]), np.sin(T_a_b[..., 2])
    x, y = T_a_b[..., 0], T_a_b[..., 1]
    return np.stack([-cosine * x - sine * y, sine * x - cosine * y, -T_a_b[..., 2]], axis=-1)


def relative_pose(T_a_b: FloatArray, T_a_c: FloatArray) -> FloatArray:
    """Return T_b_c, its turn within half a circle."""
    motion = compose(inverse_pose(T_a_b), T_a_c)
    motion[..., 2] = np.remainder(motion[..., 2] + np.pi, 2.0 * np.pi) - np.pi
    return motion


def camera_at(bearings: Bearings, distance: float) -> FloatArray:
    """Return the pose of the current camera in that of the photograph, ``distance`` [m] away."""
    # The plane of the paper has x right and y ahead of the photograph's camera.
    x, y = distance * np.sin(bearings.psi), -distance * np.cos(bearings.psi)
    return np.array([x, y, bearings.heading_error])
