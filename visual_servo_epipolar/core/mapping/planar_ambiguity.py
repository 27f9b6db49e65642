"""
Twin of a geometry: the other one that views of a plane allow.

What a view of a plane at a place p shows is I - p m^T, turned, with m . X = 1 on the plane; but
for a turn p and m may change parts (Faugeras and Lustman 1988; Hartley and Zisserman, 13.4). The
robot would then be straight before the wall, and the wall across its way. Which of both it is,
relief has to tell, or a third view far enough from both.
"""

import math

import numpy as np

from visual_servo_epipolar.core.arrays import FloatArray
from visual_servo_epipolar.core.geometry.epipolar import Bearings
from visual_servo_epipolar.core.mapping.adjustment.projection import structure_of
from visual_servo_epipolar.core.mapping.adjustment.refinement import Geometry
from visual_servo_epipolar.core.mapping.adjustment.window import HEADING

LEAST_ON_PLANE = 3  # features that a plane is fitted to, at least


def ambiguous_bearings(geometry: Geometry) -> Bearings | None:
    """Return the bearings of the last view in the twin of a ``geometry``; None without a plane."""
    if int(geometry.trusted.sum()) <= LEAST_ON_PLANE:
        return None
    return exchanged_bearings(geometry.unknowns.views[-1], _plane(geometry)[[0, 2]])


def exchanged_bearings(view: FloatArray, across: FloatArray) -> Bearings | None:
    """Return bearings of a view with place and wall ``across``, (2,), exchanged, if any."""
    place = view[:2]
    if not float(place @ place) > 0.0 or not float(across @ across) > 0.0:
        return None
    # (I - m p^T) (I - p m^T)^-1 is a turn, but for a stretch across it.
    cross = float(place[0] * across[1] - place[1] * across[0])
    turn = 2.0 * math.atan2(cross, 2.0 - float(place @ across))
    psi = math.atan2(across[1], across[0]) - 0.5 * turn
    psi += math.pi if place @ across < 0.0 else 0.0  # both are on one side of the wall
    heading = float(view[HEADING]) - turn
    return Bearings(psi, psi - heading - 0.5 * math.pi)


def _plane(geometry: Geometry) -> FloatArray:
    """Return m, (3,), with m . X = 1 on the plane that fits trusted features best."""
    window, unknowns = geometry.window, geometry.unknowns
    rows = geometry.trusted
    rays = structure_of(window.photograph, window.tangents, unknowns).rays[:, rows]
    roots = geometry.system.roots[rows, 2]
    weight = 1.0 / np.sqrt((roots * roots).sum(1))
    near = unknowns.inverse_depth[rows]
    return np.asarray(np.linalg.lstsq((rays * weight).T, near * weight, rcond=None)[0])
