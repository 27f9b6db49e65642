"""Tilt and roll of a camera that should be upright, and what is learnt of them while driving."""

from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np

from visual_servo_epipolar.core.arrays import FloatArray
from visual_servo_epipolar.core.estimators.base import Prior


class Attitudes(NamedTuple):
    """The fields of many attitudes as columns, shape (B, 1) each."""

    tilt: FloatArray
    roll: FloatArray
    tilt_deviation: FloatArray
    roll_deviation: FloatArray
    jitter: FloatArray


def attitudes_of(priors: Sequence[Prior]) -> Attitudes:
    """Return what is known of the cameras before they are looked through."""
    rows = [
        (a.tilt, a.roll, a.tilt_deviation, a.roll_deviation, a.jitter)
        for a in (prior.attitude for prior in priors)
    ]
    return Attitudes(*np.array(rows).T[:, :, None])


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
