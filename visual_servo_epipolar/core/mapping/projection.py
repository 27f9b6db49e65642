"""Projection of features into views: residuals in deviations, and their derivatives."""

import math
from typing import NamedTuple

import numpy as np

from visual_servo_epipolar.core.arrays import BoolArray, FloatArray
from visual_servo_epipolar.core.mapping.window import (
    HEADING,
    LENS,
    PHOTOGRAPH,
    ROLL,
    TILT,
    Unknowns,
)

# x, y, heading, tilt, roll; two offsets, nearness; tilt and roll of the photograph, lens.
BY_VIEW, BY_FEATURE, BY_SHARED = slice(0, 5), slice(5, 8), slice(8, 11)
OFFSETS = slice(5, 7)
BACKWARD = np.array([-1.0, 1.0])
OPPOSITE = 1e12  # square of a residual of what would lie behind its ray

# d/dr Z(r)^T = LEAN @ Z^T, d/dt X(t)^T = NOD @ X^T.
LEAN = np.array([[0.0, 1.0, 0.0], [-1.0, 0.0, 0.0], [0.0, 0.0, 0.0]])
NOD = np.array([[0.0, 0.0, 0.0], [0.0, 0.0, -1.0], [0.0, 1.0, 0.0]])


class Structure(NamedTuple):
    """
    Features in upright axes of the photograph: ``rays``, (3, N), and by unknowns, (3, 5, N).

    ``stretch`` is the focal length over the calibrated one: by so much farther from the centre
    of the image a camera sees them.
    """

    rays: FloatArray
    slopes: FloatArray  # by two offsets, tilt and roll of the photograph, lens
    inverse_depth: FloatArray
    stretch: float = 1.0


class Projection(NamedTuple):
    """
    Features in views: directions, (..., 3, N), at a length, (..., N), of points over their depths.

    ``residuals``, (..., 2, N), are in deviations; ``turns``, (..., 3, 3), lead from upright axes
    of the photograph, in which points are ``upright``, (..., 3, N), to those of cameras, with the
    stretch of the image.
    """

    points: FloatArray
    length: FloatArray
    residuals: FloatArray
    turns: FloatArray
    upright: FloatArray


def structure_of(photograph: FloatArray, tangents: FloatArray, unknowns: Unknowns) -> Structure:
    """Return the features in upright axes of the photograph."""
    tilt, roll = unknowns.shared[PHOTOGRAPH].tolist()
    upright = np.array(_turn(0.0, tilt, roll)).T
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
    return Structure(upright @ own, slopes, unknowns.inverse_depth, stretch)


def _turn(heading: float, tilt: float, roll: float) -> list[list[float]]:
    """Return what leads from upright axes to those of a camera, Z(roll)^T X(tilt)^T Y^T."""
    cos_heading, sin_heading = math.cos(heading), math.sin(heading)
    cos_tilt, sin_tilt = math.cos(tilt), math.sin(tilt)
    c, s = math.cos(roll), math.sin(roll)
    lean, nod = s * sin_tilt, c * sin_tilt
    return [
        [c * cos_heading + lean * sin_heading, s * cos_tilt, c * sin_heading - lean * cos_heading],
        [nod * sin_heading - s * cos_heading, c * cos_tilt, -s * sin_heading - nod * cos_heading],
        [-cos_tilt * sin_heading, sin_tilt, cos_tilt * cos_heading],
    ]


def turns_of(views: FloatArray, stretch: float = 1.0) -> FloatArray:
    """Return turns, (..., 3, 3), from the photograph's upright axes to ``views``, stretched."""
    each = [_turn(*attitude) for attitude in views[..., HEADING:].reshape(-1, 3).tolist()]
    turns = np.array(each).reshape(*views.shape[:-1], 3, 3)
    turns[..., :2, :] *= stretch
    return turns


def points_of(structure: Structure, views: FloatArray) -> FloatArray:
    """Return features over their depths as seen from views, but not turned, (..., 3, N)."""
    places = np.zeros((*views.shape[:-1], 3, 1))
    places[..., ::2, 0] = views[..., :HEADING]
    return np.asarray(structure.rays - places * structure.inverse_depth)


def project(structure: Structure, views: FloatArray, tangent_basis: FloatArray) -> Projection:
    """Project features into ``views``, (..., 5), with a ``tangent_basis``, (..., 2, 3, N)."""
    turns, upright = turns_of(views, structure.stretch), points_of(structure, views)
    points = turns @ upright
    length = np.sqrt(np.add.reduce(points * points, axis=-2))
    residuals = np.add.reduce(tangent_basis * points[..., None, :, :], axis=-2)
    residuals /= length[..., None, :]
    return Projection(points, length, residuals, turns, upright)


def slopes(
    structure: Structure, views: FloatArray, tangent_basis: FloatArray, projection: Projection
) -> FloatArray:
    """
    Return the derivatives of residuals by the unknowns of each, (..., 11, 2, N).

    How a point moves is never written down: what it does to residuals is carried back to axes in
    which it moves by one component or two.
    """
    points, length, residuals, turns, upright = projection
    # Of a point to the direction in which it lies: only what is across counts.
    inverse = (1.0 / length)[..., None, :]
    across = residuals[..., None, :] * (points * inverse)[..., None, :, :]
    np.subtract(tangent_basis, across, out=across)
    across *= inverse[..., None, :]
    # In upright axes of the photograph.
    carried = turns.swapaxes(-1, -2)[..., None, :, :] @ across
    found = np.empty((*points.shape[:-2], BY_SHARED.stop, 2, points.shape[-1]))
    level = carried[..., ::2, :].swapaxes(-3, -2)  # right, ahead
    np.multiply(level, -structure.inverse_depth, out=found[..., :HEADING, :, :])
    moved = level * (views[..., :HEADING] * BACKWARD)[..., None, None]
    np.subtract(moved[..., 0, :, :], moved[..., 1, :, :], out=found[..., OFFSETS.stop, :, :])
    moved = level * upright[..., ::-2, None, :]
    np.subtract(moved[..., 0, :, :], moved[..., 1, :, :], out=found[..., HEADING, :, :])
    a0, a1 = across[..., 0, :], across[..., 1, :]
    p0, p1 = points[..., :1, :], points[..., 1:2, :]
    roll = views[..., ROLL, None, None]
    c, s = np.cos(roll), np.sin(roll)
    nodded = s * p0
    nodded += c * p1
    nodded /= structure.stretch
    tilted = s * a0
    tilted += c * a1
    tilted *= structure.stretch * points[..., 2:, :]
    np.subtract(nodded * across[..., 2, :], tilted, out=found[..., TILT, :, :])
    np.subtract(a0 * p1, a1 * p0, out=found[..., ROLL, :, :])
    by_ray = np.einsum('...ain,ijn->...jan', carried, structure.slopes)
    stretched = a0 * p0
    stretched += a1 * p1
    by_ray[..., -1, :, :] += stretched
    found[..., OFFSETS, :, :] = by_ray[..., :2, :, :]
    found[..., BY_SHARED, :, :] = by_ray[..., 2:, :, :]
    return found


def squares_of(projection: Projection, rays: FloatArray) -> FloatArray:
    """Return squared residuals, (..., N), of what lies ahead of its ray; others are far off."""
    first, other = projection.residuals[..., 0, :], projection.residuals[..., 1, :]
    return np.where(is_ahead(projection, rays), first * first + other * other, OPPOSITE)


def is_ahead(projection: Projection, rays: FloatArray) -> BoolArray:
    """Return what lies on the side of its ray, (..., N): across it, opposite points look alike."""
    return np.asarray(np.add.reduce(projection.points * rays, axis=-2) > 0.0)
