"""
Walls: the second geometry that a plane fits, and sideways motion before it.

A camera that moves aside by x before a wall at Z across its axis sees all features move by x / Z.
A turn moves them by nearly as much, (1 + u^2) times an angle: the parallax that is left is a small
part of it, less than the noise of one feature. But it has a form, and over all features the noise
is known far better (a matched filter). Nothing is known of a room in front, yet features of a room
move in this form as well, on average.
"""

import math

import numpy as np

from visual_servo_epipolar.core.arrays import FloatArray, median
from visual_servo_epipolar.core.geometry.epipolar import Bearings, MIN_MATCHES
from visual_servo_epipolar.core.geometry.least_squares import (
    cauchy,
    REWEIGHTINGS,
    robust_fit,
    SMALLEST,
    USUAL_SQUARES,
)
from visual_servo_epipolar.core.geometry.rays import image_points
from visual_servo_epipolar.core.geometry.rotation import fit_rotation

LEAST_FORWARD = 0.5  # of a ray: 60 deg off the axis


def exchanged_bearings(view: FloatArray, across: FloatArray) -> Bearings | None:
    """
    Return bearings of a ``view`` with its place and the plane ``across`` exchanged, if any.

    What a view of a plane at a place p shows is I - p m^T, turned, with m . X = 1 on the plane;
    but for a turn p and m may change parts (Faugeras and Lustman 1988; Hartley and Zisserman,
    13.4): the robot straight before the wall, and the wall across its way. The ``view`` is its
    place, right and ahead, and its heading error [rad], (3,); m right and ahead, ``across``, (2,).
    The sign of the bearings is that of a robot on the same side of the plane.
    """
    place = view[:2]
    if not float(place @ place) > 0.0 or not float(across @ across) > 0.0:
        return None
    # (I - m p^T) (I - p m^T)^-1 is a turn, but for a stretch across it.
    cross = float(place[0] * across[1] - place[1] * across[0])
    turn = 2.0 * math.atan2(cross, 2.0 - float(place @ across))
    psi = math.atan2(across[1], across[0]) - 0.5 * turn
    psi += math.pi if place @ across < 0.0 else 0.0  # both are on one side of the wall
    heading = float(view[2]) - turn
    return Bearings(psi, psi - heading - 0.5 * math.pi)


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
    if int(ahead.sum()) < MIN_MATCHES:
        return 0.0
    seen, points = image_points(carried[ahead]), image_points(desired[ahead])
    moved = (points - seen).T.ravel()  # of the scene to the photograph: as the camera is aside
    fit = robust_fit(_forms(points), moved, _weights, REWEIGHTINGS)
    if fit is None:
        return 0.0
    own = float(fit.covariance()[0, 0])
    return float(fit.solution[0]) / math.sqrt(_noise(fit.residual)[1] * own)


def _noise(residual: FloatArray) -> tuple[FloatArray, float]:
    """Return squared lengths of what points are off by, (N,), and the variance of a coordinate."""
    off = residual.reshape(2, -1)
    squares = (off * off).sum(0)
    return squares, max(median(squares) / USUAL_SQUARES, SMALLEST)


def _weights(residual: FloatArray) -> FloatArray:
    squares, variance = _noise(residual)
    return np.tile(cauchy(squares, 9.0 * variance) ** 2, 2)


def _forms(points: FloatArray) -> FloatArray:
    """Return how points, (N, 2), move by an offset aside, an advance and three turns, (2N, 5)."""
    u, v = points.T
    one, none = np.ones_like(u), np.zeros_like(u)
    across = np.stack([one, u, u * v, 1.0 + u * u, v], axis=1)
    along = np.stack([none, v, 1.0 + v * v, u * v, -u], axis=1)
    return np.concatenate([across, along])
