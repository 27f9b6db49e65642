"""Projection of features into views: residuals in deviations, and their derivatives."""

import math
from typing import NamedTuple

import numpy as np

from visual_servo_epipolar.core.arrays import BoolArray, FloatArray
from visual_servo_epipolar.core.memory.window import (
    HEADING,
    LENS,
    PHOTOGRAPH,
    ROLL,
    TILT,
    Unknowns,
    X,
    Y,
)

# x, y, heading, tilt, roll; two offsets, nearness; tilt and roll of the photograph, lens.
BY_VIEW, BY_FEATURE, BY_SHARED = slice(0, 5), slice(5, 8), slice(8, 11)
UNKNOWNS = 11
OPPOSITE = 1e12  # square of a residual of what would lie behind its ray

# d/dh R(h)^T = R^T @ TURN, d/dr Z(r)^T = LEAN @ Z^T, d/dt X(t)^T = NOD @ X^T.
TURN = np.array([[0.0, 0.0, 1.0], [0.0, 0.0, 0.0], [-1.0, 0.0, 0.0]])
LEAN = np.array([[0.0, 1.0, 0.0], [-1.0, 0.0, 0.0], [0.0, 0.0, 0.0]])
NOD = np.array([[0.0, 0.0, 0.0], [0.0, 0.0, -1.0], [0.0, 1.0, 0.0]])


class Structure(NamedTuple):
    """
    Features in upright axes of the photograph: ``rays``, (3, N), and by unknowns, (3, 5, N).

    ``stretch`` is the focal length over the one that was told: by so much farther from the centre
    of the image a camera sees them.
    """

    rays: FloatArray
    slopes: FloatArray  # by two offsets, tilt and roll of the photograph, lens
    nearness: FloatArray
    stretch: float = 1.0


class Projection(NamedTuple):
    """
    Features in views: directions, (K, 3, N), at a length, (K, N), of points over their depths.

    ``residuals``, (K, 2, N), are in deviations; ``turns``, (K, 3, 3), lead from upright axes of
    the photograph to those of cameras, with the stretch of the image.
    """

    points: FloatArray
    length: FloatArray
    residuals: FloatArray
    turns: FloatArray


def structure_of(photograph: FloatArray, tangents: FloatArray, unknowns: Unknowns) -> Structure:
    """Return the features in upright axes of the photograph."""
    tilt, roll = unknowns.shared[PHOTOGRAPH].tolist()
    upright = _to_camera(np.array([tilt]), np.array([roll]))[0].T
    offsets = unknowns.offsets
    stretch = math.exp(unknowns.shared[LENS])
    # Camera, then its offsets: what the photograph shows, moved across.
    seen = photograph.T / np.array([[stretch], [stretch], [1.0]])
    own = seen + tangents[0] * offsets[0] + tangents[1] * offsets[1]
    inward = -upright[:, :2] @ seen[:2]
    rolled = LEAN.T @ own
    tilted = NOD.T @ (upright @ own)
    # upright = X Z, d/dr = X Z' = X Z LEAN^T, d/dt = X' Z = NOD^T X Z.
    slopes = np.stack(
        [upright @ tangents[0], upright @ tangents[1], tilted, upright @ rolled, inward], axis=1
    )
    return Structure(upright @ own, slopes, unknowns.nearness, stretch)


def _to_camera(tilt: FloatArray, roll: FloatArray) -> FloatArray:
    """Return the rotations from upright axes to those of cameras, Z(roll)^T X(tilt)^T."""
    c, s, cos_tilt, sin_tilt = np.cos(roll), np.sin(roll), np.cos(tilt), np.sin(tilt)
    turns = np.zeros((len(tilt), 3, 3))
    turns[:, 0, 0], turns[:, 0, 1], turns[:, 0, 2] = c, s * cos_tilt, -s * sin_tilt
    turns[:, 1, 0], turns[:, 1, 1], turns[:, 1, 2] = -s, c * cos_tilt, -c * sin_tilt
    turns[:, 2, 1], turns[:, 2, 2] = sin_tilt, cos_tilt
    return turns


def turns_of(views: FloatArray, stretch: float = 1.0) -> FloatArray:
    """
    Return what leads from upright axes of the photograph to those of cameras, (K, 3, 3).

    Rotations, and the ``stretch`` of the image.
    """
    cosine, sine = np.cos(views[:, HEADING]), np.sin(views[:, HEADING])
    back = np.zeros((len(views), 3, 3))
    back[:, 0, 0] = back[:, 2, 2] = cosine
    back[:, 0, 2], back[:, 2, 0], back[:, 1, 1] = sine, -sine, 1.0
    turns = _to_camera(views[:, TILT], views[:, ROLL]) @ back
    turns[:, :2] *= stretch
    return np.asarray(turns)


def points_of(structure: Structure, views: FloatArray) -> FloatArray:
    """Return features over their depths as seen from views, but not turned, (K, 3, N)."""
    points = np.repeat(structure.rays[None], len(views), axis=0)
    points[:, 0] -= views[:, X, None] * structure.nearness
    points[:, 2] -= views[:, Y, None] * structure.nearness
    return points


def projected(structure: Structure, views: FloatArray, sides: FloatArray) -> Projection:
    """Project features into ``views``, (K, 5), whose rays have ``sides``, (K, 2, 3, N)."""
    turns = turns_of(views, structure.stretch)
    points = turns @ points_of(structure, views)
    length = np.sqrt((points * points).sum(1))
    residuals = _along(sides, points) / length[:, None]
    return Projection(points, length, residuals, turns)


def slopes(
    structure: Structure, views: FloatArray, sides: FloatArray, projection: Projection
) -> FloatArray:
    """Return the derivatives of residuals by the unknowns of each, (K, 11, 2, N)."""
    points, length, residuals, turns = projection
    moves = _moves(structure, views, points, turns)
    # Of a point to the direction in which it lies: only what is across counts.
    directions = points / length[:, None]
    across = (sides - residuals[:, :, None] * directions[:, None]) / length[:, None, None]
    found = moves[:, :, 0, None] * across[:, None, :, 0]
    found += moves[:, :, 1, None] * across[:, None, :, 1]
    found += moves[:, :, 2, None] * across[:, None, :, 2]
    return found


def _moves(
    structure: Structure, views: FloatArray, points: FloatArray, turns: FloatArray
) -> FloatArray:
    """Return how points move by the unknowns of each, in axes of cameras, (K, 11, 3, N)."""
    near = structure.nearness
    count, size = points.shape[0], points.shape[-1]
    moves = np.empty((count, UNKNOWNS, 3, size))
    right, ahead = turns[:, :, 0, None], turns[:, :, 2, None]
    moves[:, X], moves[:, Y] = -near * right, -near * ahead
    lean = turns_of_roll(views)
    stretch = np.array([structure.stretch, structure.stretch, 1.0])
    turning = np.empty((count, 3, 3, 3))
    turning[:, 0] = turns @ TURN @ (turns / stretch[:, None] ** 2).swapaxes(1, 2)
    turning[:, 1] = lean @ NOD @ lean.swapaxes(1, 2) * (stretch[:, None] / stretch)
    turning[:, 2] = LEAN
    moves[:, HEADING : ROLL + 1] = (turning.reshape(count, 9, 3) @ points).reshape(
        count, 3, 3, size
    )
    others = (turns @ structure.slopes.reshape(3, -1)).reshape(count, 3, 5, size)
    others = others.swapaxes(1, 2)
    moves[:, 5:7], moves[:, BY_SHARED] = others[:, :2], others[:, 2:]
    moves[:, 10, :2] += points[:, :2]
    moves[:, 7] = -(views[:, X, None, None] * right + views[:, Y, None, None] * ahead)
    return moves


def turns_of_roll(views: FloatArray) -> FloatArray:
    """Return Z(roll)^T of views, (K, 3, 3)."""
    return _to_camera(np.zeros(len(views)), views[:, ROLL])


def _along(sides: FloatArray, points: FloatArray) -> FloatArray:
    """Return the components of points, (K, 3, N), along ``sides``, (K, 2, 3, N): (K, 2, N)."""
    x, y, z = (sides[:, :, j] * points[:, None, j] for j in range(3))
    return np.asarray(x + y + z)


def squares_of(projection: Projection, rays: FloatArray) -> FloatArray:
    """Return squared residuals, (K, N), of what lies ahead of its ray; others count as far off."""
    first, other = projection.residuals[:, 0], projection.residuals[:, 1]
    return np.where(is_ahead(projection, rays), first * first + other * other, OPPOSITE)


def is_ahead(projection: Projection, rays: FloatArray) -> BoolArray:
    """Return what lies on the side of its ray, (K, N): across it, opposite points look alike."""
    return np.asarray((projection.points * rays).sum(1) > 0.0)
