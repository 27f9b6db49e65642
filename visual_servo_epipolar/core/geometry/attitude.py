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


def level(u: FloatArray, v: FloatArray, tilt: Any, roll: Any) -> tuple[FloatArray, FloatArray]:
    """Return rays (u, v) as an upright camera sees them; tilt and roll broadcast against them."""
    cos_roll, sin_roll = np.cos(roll), np.sin(roll)
    x, y = cos_roll * u - sin_roll * v, sin_roll * u + cos_roll * v
    cos_tilt, sin_tilt = np.cos(tilt), np.sin(tilt)
    z = cos_tilt - sin_tilt * y
    return x / z, (cos_tilt * y + sin_tilt) / z
