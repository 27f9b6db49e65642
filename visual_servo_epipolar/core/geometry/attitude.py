"""Tilt and roll of a camera that should be upright."""

from typing import Any

import numpy as np

from visual_servo_epipolar.core.arrays import FloatArray


def rotation_level_camera(tilt: float, roll: float) -> FloatArray:
    """Return the rotation, shape (3, 3), from camera axes to those of an upright camera."""
    c, s = np.cos(tilt), np.sin(tilt)
    tilted = np.array([[1.0, 0.0, 0.0], [0.0, c, s], [0.0, -s, c]])
    c, s = np.cos(roll), np.sin(roll)
    return np.asarray(tilted @ np.array([[c, -s, 0.0], [s, c, 0.0], [0.0, 0.0, 1.0]]))


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
