"""
Sideways motion before a wall: what a turn of the camera explains nearly, and a photograph's rays.

A camera that moves aside by x before a wall at Z across its axis sees all features move by x / Z.
A turn moves them by nearly as much, (1 + u^2) times an angle: the parallax that is left is a small
part of it, less than the noise of one feature. But it has a form, and over all features the noise
is known far better (a matched filter). Nothing is known of a room in front, yet features of a room
move in this form as well, on average.
"""

import math

import numpy as np

from visual_servo_epipolar.core.arrays import FloatArray, median
from visual_servo_epipolar.core.geometry.rotation import fit_rotation

LEAST_FORWARD = 0.5  # of a ray: 60 deg off the axis
LEAST_FEATURES = 8
ITERATIONS = 6
USUAL_MEDIAN = 1.386  # of a sum of two squares of deviation 1
SMALLEST = 1e-18  # variance of a coordinate at least [rad^2]


def aside(current: FloatArray, desired: FloatArray) -> float:
    """
    Return by how many of its deviations a camera stands aside of where a photograph was taken.

    Unit rays have shape (N, 3); right positive. Turn, advance and offset are fitted to the
    features that are ahead, reweighted (Geman-McClure), with the noise that they leave. 0 of too
    few features. It counts where the camera is turned as in the photograph: through a focal
    length that is 5 % off, a turn of half a degree looks like a centimetre.
    """
    carried = current @ fit_rotation(current, desired).rotation.T
    ahead = (carried[:, 2] > LEAST_FORWARD) & (desired[:, 2] > LEAST_FORWARD)
    if int(ahead.sum()) < LEAST_FEATURES:
        return 0.0
    seen, points = _points(carried[ahead]), _points(desired[ahead])
    moved = (points - seen).T.ravel()  # of the scene to the photograph: as the camera is aside
    forms = _forms(points)
    weights = np.ones(len(points))
    for _ in range(ITERATIONS):
        both = np.concatenate([weights, weights])
        normal = forms.T @ (both[:, None] * forms)
        if np.linalg.cond(normal) > 1.0 / np.finfo(np.float64).eps:
            return 0.0
        solution = np.linalg.solve(normal, forms.T @ (both * moved))
        residual = (moved - forms @ solution).reshape(2, -1)
        squares = (residual * residual).sum(0)
        variance = max(median(squares) / USUAL_MEDIAN, SMALLEST)
        weights = 1.0 / (1.0 + squares / (9.0 * variance)) ** 2
    own = float(np.linalg.inv(normal)[0, 0])
    return float(solution[0]) / math.sqrt(variance * own)


def _points(rays: FloatArray) -> FloatArray:
    return np.asarray(rays[:, :2] / rays[:, 2:])


def _forms(points: FloatArray) -> FloatArray:
    """Return how points, (N, 2), move by an offset aside, an advance and three turns, (2N, 5)."""
    u, v = points.T
    one, none = np.ones_like(u), np.zeros_like(u)
    across = np.stack([one, u, u * v, 1.0 + u * u, v], axis=1)
    along = np.stack([none, v, 1.0 + v * v, u * v, -u], axis=1)
    return np.concatenate([across, along])
