"""Taught path: where a camera is beside it, and how noisy places along a way become one."""

from dataclasses import dataclass, fields
from functools import cached_property
import math
from typing import NamedTuple

import numpy as np

from visual_servo_epipolar.core.arrays import FloatArray, NORMAL
from visual_servo_epipolar.core.geometry.least_squares import CONTRADICTING, linear_fit

HALF_WIDTH = 0.25  # of the way over which a sample is smoothed [m]
LEAST = 5  # samples within it, where there are fewer farther ones count; and at most looked at
ROUNDS = 4
FLOOR = 1e-4  # of such a deviation [m, rad]
LEAST_STEP = 0.01  # between samples, or two images that are kept [m]


class PathPoint(NamedTuple):
    """
    Point of the taught path, and where a camera is beside it.

    ``way`` from the start of the route [m], ``offset`` to the left of the path [m], ``turn`` of
    the camera against its taught heading, to the left [rad]; ``curvature`` [1/m] and ``speed``
    [m/s] as taught there.
    """

    way: float
    offset: float
    turn: float
    curvature: float
    speed: float


@dataclass(frozen=True, eq=False)
class TaughtPath:
    """
    The path as taught, by samples: ``way`` [m] from the start of the route, (M,), ascending.

    ``poses``, (M, 3), are those of the camera in axes of the key view: forward, left [m], turn to
    the left [rad]; ``curvatures`` [1/m] and ``speeds`` [m/s], (M,).
    """

    way: FloatArray
    poses: FloatArray
    curvatures: FloatArray
    speeds: FloatArray

    def __post_init__(self) -> None:
        count = len(self.way)
        if count < 2 or not (np.diff(self.way) > 0.0).all():
            raise ValueError(
                f'a taught path must have two samples or more, one after the other, got {count}; '
                'drive on before the next key view'
            )

    @cached_property
    def _tangents(self) -> FloatArray:
        """Unit tangents, (M, 2), of the way that the camera takes."""
        slopes = np.gradient(self.poses[:, :2], self.way, axis=0)
        return np.asarray(slopes / np.linalg.norm(slopes, axis=1, keepdims=True))

    def followed_by(self, path: 'TaughtPath') -> 'TaughtPath':
        """Return this path and then another one, in the same axes."""
        columns = [(getattr(self, it.name), getattr(path, it.name)) for it in fields(self)]
        return TaughtPath(*(np.concatenate(column) for column in columns))

    def beside(self, pose: FloatArray, near: float) -> PathPoint:
        """Return where a camera ``pose``, (3,), is, on the path not far from ``near`` [m]."""
        last = int(np.searchsorted(self.way, near))
        first = max(last - LEAST, 0)
        part = slice(first, min(last + LEAST, len(self.way)))
        apart = pose[:2] - self.poses[part, :2]
        k = first + int(np.argmin((apart * apart).sum(1)))
        tangent, away = self._tangents[k], pose[:2] - self.poses[k, :2]
        along = float(tangent @ away)
        offset = float(tangent[0] * away[1] - tangent[1] * away[0])
        curvature = float(self.curvatures[k])
        # Off a sample the path bends away from its tangent.
        offset -= 0.5 * curvature * along * along
        turn = float(pose[2] - self.poses[k, 2]) - curvature * along
        return PathPoint(
            float(self.way[k]) + along,
            offset,
            math.remainder(turn, 2.0 * math.pi),
            self.curvature_at(float(self.way[k]) + along),
            float(self.speeds[k]),
        )

    def pose_at(self, way: float) -> FloatArray:
        """Return the taught pose of the camera, (3,), at a ``way`` [m]; it goes on straight."""
        pose = np.array([np.interp(way, self.way, column) for column in self.poses.T])
        if way < self.way[0]:
            pose[:2] += (way - self.way[0]) * self._tangents[0]
        elif way > self.way[-1]:
            pose[:2] += (way - self.way[-1]) * self._tangents[-1]
        return pose

    def curvature_at(self, way: float) -> float:
        """Return the taught curvature at a ``way`` [m], in 1/m."""
        return float(np.interp(way, self.way, self.curvatures))


def smooth_path(way: FloatArray, poses: FloatArray, speeds: FloatArray) -> TaughtPath:
    """Return the path by noisy ``poses``, (M, 3), after ``way``, (M,) [m], at ``speeds``, (M,)."""
    kept = np.concatenate([[True], np.diff(way) > LEAST_STEP]) if len(way) else np.zeros(0, bool)
    way, speeds = way[kept], speeds[kept]
    poses = poses[kept]
    poses[:, 2] = np.unwrap(poses[:, 2])
    if len(way) < LEAST:
        curvatures = np.zeros(len(way))
        return TaughtPath(way, poses, curvatures, speeds)
    weight = np.ones(len(way))
    for _ in range(ROUNDS):
        off = np.abs(poses - _fitted(way, poses, weight)[0])
        usual = NORMAL * np.median(off, axis=0) + FLOOR
        weight = 1.0 / (1.0 + ((off / (math.sqrt(CONTRADICTING) * usual)).max(axis=1)) ** 4)
    smooth, slopes = _fitted(way, poses, weight)
    speed, _ = _fitted(way, speeds[:, None], np.ones(len(way)))
    return TaughtPath(way, smooth, slopes[:, 2], np.maximum(speed[:, 0], 0.0))


def _fitted(
    way: FloatArray, values: FloatArray, weight: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Return values and slopes of parabolas fitted around each sample, (M, K) both."""
    smooth, slopes = np.empty_like(values), np.empty_like(values)
    for k, at in enumerate(way.tolist()):
        apart = way - at
        reach = max(HALF_WIDTH, float(np.sort(np.abs(apart))[min(LEAST, len(way)) - 1]) * 1.01)
        share = np.maximum(1.0 - (apart / reach) ** 2, 0.0) * weight
        columns = np.stack([np.ones_like(apart), apart, apart * apart], axis=1)
        smooth[k], slopes[k], _ = linear_fit(columns, values, share, ridge=1e-9).solution
    return smooth, slopes
