"""
Arcs: where one motion ends that may not bend more than a base can, and how to back off for it.

The law of ``steering`` is driven ahead in thought, at the bounded curvature, with the features in
view; a base that is steered late drives slower for it, on the same path. Where the motion does not
end on the goal's axis, the robot first backs off on an arc, that of the least way there and back.
"""

import math
from typing import NamedTuple

import numpy as np

from visual_servo_epipolar.core.arrays import FloatArray
from visual_servo_epipolar.core.bases.car import LAG_WAY
from visual_servo_epipolar.core.laws.smooth.steering import GAINS

STEP, LEAST_STEP = 0.06, 0.006  # of a way ahead in thought: part of the distance, at least [m]
STEPS = 110
LEAST_AHEAD = 0.1  # of the goal, on its axis, where the law ends [m]
WAYS = np.array([0.0, 0.1, 0.2, 0.3, 0.45, 0.6, 0.8, 1.0, 1.3, 1.6, 2.0, 2.5, 3.2, 4.0, 5.0])
BENDS = np.array([0.0, -0.3, 0.3, -0.6, 0.6, -1.0, 1.0])  # of the largest curvature
ASIDE, TURNED = 1e-3, 5e-3  # error at which a way ends at the goal [m], [rad]


class GoalOffset(NamedTuple):
    """Places of robots, shape (N,): right and ahead of the goal [m], heading error [rad]."""

    x: FloatArray
    y: FloatArray
    heading: FloatArray


class Bounds(NamedTuple):
    """
    Bounds of a path.

    ``curvature``, the largest [1/m]; ``left`` and ``right``, how far it may turn from the present
    heading so that features stay in view [rad].
    """

    curvature: float
    left: float
    right: float


def moved(place: GoalOffset, way: FloatArray, kappa: FloatArray) -> GoalOffset:
    """Return where ``way`` [m], backward negative, leads on arcs of curvature ``kappa`` [1/m]."""
    turn = kappa * way
    chord = way * np.sinc(0.5 * turn / np.pi)
    middle = place.heading + 0.5 * turn
    return GoalOffset(
        place.x - chord * np.sin(middle), place.y + chord * np.cos(middle), place.heading + turn
    )


def misses(place: GoalOffset, heading: float, bounds: Bounds) -> FloatArray:
    """
    Return by how much the motion from each ``place`` misses the goal: 1 is what it may.

    ``heading`` is the one that ``bounds`` count their turns from. inf where it begins out of view,
    or past the goal.
    """
    low, high = heading - bounds.right, heading + bounds.left
    lost = (place.heading < low) | (place.heading > high) | (place.y >= 0.0)
    for _ in range(STEPS):
        way = np.minimum(
            np.maximum(STEP * np.hypot(place.x, place.y), LEAST_STEP),
            np.maximum(-place.y, 0.0) / np.maximum(np.cos(place.heading), 0.2),
        )
        if not way.any():
            break
        wanted = _curvature(place, low, high)
        place = moved(place, way, np.clip(wanted, -bounds.curvature, bounds.curvature))
    error = np.hypot(place.x / ASIDE, place.heading / TURNED)
    return np.where(lost | (place.y < -LEAST_STEP), np.inf, error)


def _curvature(place: GoalOffset, low: float, high: float) -> FloatArray:
    """Return what ``steering`` asks for at each ``place`` [1/m], with features in view."""
    ahead = np.maximum(LEAST_AHEAD + place.y, 0.0)
    distance = np.hypot(place.x, ahead - place.y)
    phi = 0.5 * np.pi - np.arctan2(ahead - place.y, -place.x)
    delta = place.heading + phi
    aim = np.arctan(-GAINS.k1 * phi)
    held = np.clip(aim, low + phi, high + phi)
    rate = GAINS.k1 / (1.0 + (GAINS.k1 * phi) ** 2)
    damping = np.where(held == aim, (1.0 + rate) * np.sin(delta), 0.0)
    return np.asarray(-(GAINS.k2 * (delta - held) + damping) / distance)


class Backing(NamedTuple):
    """A way back: its curvature [1/m] and length [m]; inf where none leads to the goal."""

    curvature: float
    way: float


def way_back(place: tuple[float, float, float], kappa: float, bounds: Bounds) -> Backing:
    """
    Return the shortest arc backward from ``place`` after which one motion ends at the goal.

    ``kappa`` is the curvature of the present way back [1/m], which costs least to keep.
    """
    bends, ways = (
        item.ravel() for item in np.meshgrid(BENDS * bounds.curvature, WAYS, indexing='ij')
    )
    start = GoalOffset(*(np.full(len(ways), value) for value in place))
    behind = moved(start, -ways, bends)
    missed = misses(behind, place[2], bounds)
    cost = 2.0 * ways + 0.1 * np.abs(bends - kappa) * (ways > 0.0) + np.hypot(behind.x, behind.y)
    cost[missed > 1.0] = np.inf
    best = int(np.argmin(cost))
    return Backing(float(bends[best]), float(ways[best]) if np.isfinite(cost[best]) else np.inf)


def lagged(kappa: float, wanted: float, way: float) -> float:
    """Return the curvature [1/m] after a ``way`` [m] on which the wheels turn to ``wanted``."""
    return wanted + (kappa - wanted) * math.exp(-way / LAG_WAY)


def lag_way(way: float) -> float:
    """Return the part of a ``way`` [m] that is lost while the wheels turn."""
    return LAG_WAY * (1.0 - math.exp(-way / LAG_WAY))


def turned_back(kappa: float, way: float, most: float) -> float:
    """Return the turn [rad] against a curvature ``kappa`` that a ``way`` [m] allows."""
    return most * way - (most + kappa) * lag_way(way)
