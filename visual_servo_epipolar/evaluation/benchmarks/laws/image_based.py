"""
Image-based: the classical law on points (Espiau, Chaumette, Rives 1992), for a unicycle.

The interaction matrix keeps the columns of v and w alone, at the depth of the scene from the goal:
x' = x v / Z + (1 + x^2) w and y' = y v / Z + x y w for a ray (x, y). The robot cannot do what the
image asks sideways: where the error has no part along the two columns it stands still.
"""

from dataclasses import dataclass

import numpy as np

from visual_servo_epipolar.core.arrays import FloatArray
from visual_servo_epipolar.core.geometry.motion import Twist
from visual_servo_epipolar.core.settings import setting, Settings


@dataclass(frozen=True, kw_only=True)
class PointGains(Settings):
    """Gain of the classical law, and the depth that it takes for every point's."""

    depth: float = setting(5.0, 'Depth Z of the points from the goal [m]', low=0.1, high=100.0)
    gain: float = setting(0.3, 'Gain lambda [1/s]', low=0.01, high=5.0)


def points(current: FloatArray, desired: FloatArray, gains: PointGains) -> Twist:
    """Return -lambda L^+ (s - s*) for rays, shape (N, 2) each."""
    x, y = current.T
    forward = np.concatenate([x, y]) / gains.depth
    turn = np.concatenate([1.0 + x * x, x * y])
    matrix = np.stack([forward, turn], axis=1)
    error = (current - desired).T.reshape(-1)
    linear, angular = -gains.gain * np.linalg.lstsq(matrix, error, rcond=None)[0]
    return Twist(float(linear), float(angular))
