"""
Camera path: how a drive moves the camera's place, in modified polar coordinates.

The unknowns are psi [rad], the logarithm of the distance [m], the yaw of the camera [rad] and its
lever arm forward and left [m], in axes of the goal's camera (x right, y forward).
"""

import math
from typing import NamedTuple

import numpy as np

from visual_servo_epipolar.core.arrays import FloatArray
from visual_servo_epipolar.core.rigs.fixed_mount import camera_swing

PSI, RHO, YAW, FORWARD, LEFT = range(5)
IDENTITY = np.eye(5)
NEAREST = 0.02  # [m]


class PathPrediction(NamedTuple):
    """Place after a drive: ``mean``, (5,), its ``transition``, (5, 5), and distance squared."""

    mean: FloatArray
    transition: FloatArray
    square: float

    def from_mean(self, mean: FloatArray, at: FloatArray) -> FloatArray:
        """Return where the drive leads from ``mean``, (5,), as linear about ``at``, (5,)."""
        return self.mean if mean is at else self.mean + self.transition @ (mean - at)


def predict_path(mean: FloatArray, headings: tuple[float, float], travel: float) -> PathPrediction:
    """Return the place after a ``travel`` [m] from the first of two ``headings`` to the second."""
    psi, rho, yaw, *lever = mean.tolist()
    before, after = headings
    distance = math.exp(rho)
    middle = before + 0.5 * math.remainder(after - before, 2.0 * math.pi)
    right, ahead = -travel * math.sin(middle - yaw), travel * math.cos(middle - yaw)
    swing = camera_swing(before, after)
    by_forward, by_left = (swing @ lever).tolist()
    x, y = distance * math.cos(psi), distance * math.sin(psi)
    new_x, new_y = right + by_forward + x, ahead + by_left + y
    square = max(new_x * new_x + new_y * new_y, NEAREST**2)
    (right_f, right_l), (ahead_f, ahead_l) = swing.tolist()
    # derivatives of the new place by the unknowns
    by_place = np.array([[-y, x, ahead, right_f, right_l], [x, y, -right, ahead_f, ahead_l]])
    east, north = new_x / square, new_y / square
    transition = IDENTITY.copy()
    transition[:2] = np.array([[-north, east], [east, north]]) @ by_place
    moved = mean.copy()
    turn = math.remainder(math.atan2(new_y, new_x) - psi, 2.0 * math.pi)
    moved[:2] = psi + turn, 0.5 * math.log(square)
    return PathPrediction(moved, transition, square)
