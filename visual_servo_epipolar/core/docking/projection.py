"""Projection of features into views: residuals in deviations, and their derivatives."""

from typing import NamedTuple

import numpy as np

from visual_servo_epipolar.core.arrays import FloatArray
from visual_servo_epipolar.core.docking.unknowns import (
    about_left,
    across,
    attitude,
    FORWARD,
    headings,
    LEFT,
    Problem,
    ROLL,
    TILT,
    Unknowns,
    UP,
)


class Projection(NamedTuple):
    """
    Features in views, shapes (N, K, ...), in axes of upright cameras, or of the photograph's.

    ``rays``, (N, 3), of the photograph; ``points`` on them, seen from the views, as ``directions``
    at a ``length``; the rays ``seen``, with two directions ``across`` each, (N, K, 2, 3), per
    deviation; ``residuals``, (N, K, 2), in deviations.
    """

    rays: FloatArray
    points: FloatArray
    length: FloatArray
    directions: FloatArray
    seen: FloatArray
    across: FloatArray
    residuals: FloatArray


class Slopes(NamedTuple):
    """Derivatives of residuals, (N, K, 2, ...), by the view, the attitude and the feature."""

    by_view: FloatArray
    by_attitude: FloatArray
    by_feature: FloatArray


def projected(problem: Problem, unknowns: Unknowns) -> Projection:
    """Project the features of ``unknowns`` into the views of a ``problem``."""
    turn, tangents = unknowns.attitude, problem.tangents
    moved = problem.photograph + (tangents @ unknowns.offsets[..., None])[..., 0]
    rays = moved @ turn.T
    # A point is the ray over its inverse depth, seen from there: no length but a direction.
    shift = unknowns.nearness[:, None, None] * unknowns.places[None]
    points = _turned(headings(unknowns.views).swapaxes(1, 2), rays[:, None, :] - shift)
    length = np.sqrt((points * points).sum(-1))[..., None]
    directions = points / length
    seen = level(problem, unknowns)
    sides = across(seen) / problem.noise[..., None, None]
    residuals = (sides @ (directions - seen)[..., None])[..., 0]
    return Projection(rays, points, length, directions, seen, sides, residuals)


def slopes(problem: Problem, unknowns: Unknowns, projection: Projection) -> Slopes:
    """Return the derivatives of the residuals of a ``projection``."""
    _, points, length, directions, seen, sides, _ = projection
    back = headings(unknowns.views).swapaxes(1, 2)
    # Of a point to the direction in which it lies: only what is across counts.
    by_point = (sides - (sides @ directions[..., None]) * directions[..., None, :]) / length[
        ..., None
    ]
    near = unknowns.nearness[:, None, None]
    moves = np.stack(
        [-near * back[None, :, :, 0], -near * back[None, :, :, 1], -_cross(UP, points)], axis=-1
    )
    tilts = unknowns.shared[TILT] + unknowns.views[:, 3]
    axes = np.stack([about_left(tilt) @ FORWARD for tilt in tilts])
    by_floor = -sides @ np.stack([_cross(LEFT, seen), _cross(axes, seen)], axis=-1)
    return Slopes(
        np.concatenate([by_point @ moves, by_floor], axis=-1),
        by_point @ _by_attitude(unknowns, projection, back) + by_floor,
        by_point @ _by_feature(problem, unknowns, back),
    )


def level(problem: Problem, unknowns: Unknowns) -> FloatArray:
    """Return the rays of views in axes of upright cameras, shape (N, K, 3)."""
    tilt, roll = unknowns.shared[TILT], unknowns.shared[ROLL]
    turns = [attitude(tilt + extra, roll + other) for extra, other in unknowns.views[:, 3:]]
    return _turned(np.stack(turns), problem.rays)


def _by_attitude(unknowns: Unknowns, projection: Projection, back: FloatArray) -> FloatArray:
    """Return how points move by tilt and roll of the photograph, shape (N, K, 3, 2)."""
    rolled = about_left(unknowns.shared[TILT]) @ FORWARD
    turned = [_cross(axis, projection.rays)[:, None, :] for axis in (LEFT, rolled)]
    return np.stack([_turned(back, each) for each in turned], axis=-1)


def _by_feature(problem: Problem, unknowns: Unknowns, back: FloatArray) -> FloatArray:
    """Return how points move by offsets and inverse depths, shape (N, K, 3, 3)."""
    offsets = back[None] @ (unknowns.attitude @ problem.tangents)[:, None]
    depth = -(back @ unknowns.places[..., None])[None]
    return np.concatenate([offsets, np.broadcast_to(depth, (*offsets.shape[:3], 1))], axis=-1)


def _turned(rotations: FloatArray, vectors: FloatArray) -> FloatArray:
    """Return vectors, (N, K or 1, 3), turned by the rotation of each view, (K, 3, 3)."""
    return np.asarray((rotations[None] @ vectors[..., None])[..., 0])


def _cross(first: FloatArray, other: FloatArray) -> FloatArray:
    """Return the vector product; np.cross spends longer on its arguments than on these."""
    a, b, c = first[..., 0], first[..., 1], first[..., 2]
    x, y, z = other[..., 0], other[..., 1], other[..., 2]
    return np.stack([b * z - c * y, c * x - a * z, a * y - b * x], axis=-1)


def nearness_of(problem: Problem, views: FloatArray, shared: FloatArray) -> FloatArray:
    """Return the inverse depths, (N,), that fit best where all else is as given."""
    count = len(problem.photograph)
    unknowns = Unknowns(views, shared, np.zeros((count, 2)), np.zeros(count))
    rays = (problem.photograph @ unknowns.attitude.T)[:, None, :]
    seen = _turned(headings(views), level(problem, unknowns))
    side, shift = _cross(seen, rays), _cross(seen, unknowns.places[None])
    weight = problem.seen / problem.noise**2
    told = (weight * (shift * shift).sum(-1)).sum(1)
    return np.asarray((weight * (side * shift).sum(-1)).sum(1) / np.maximum(told, 1e-9))
