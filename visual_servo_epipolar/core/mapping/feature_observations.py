"""Feature observations: what one view shows of features; settings of the map."""

from dataclasses import dataclass
from typing import Any

import numpy as np

from visual_servo_epipolar.core.arrays import BoolArray, FloatArray, frozen, IntArray, median
from visual_servo_epipolar.core.geometry.rays import tangents
from visual_servo_epipolar.core.geometry.rotation import fit_rotation, MIN_POINTS

COLLECTED_PARALLAX = 20.0  # in deviations of the noise, that collected views differ by at least


@dataclass(frozen=True, slots=True, eq=False)
class FeatureObservations:
    """
    The features that one view shows, rows are features.

    ``ids``, shape (N,), never change their meaning while there is one photograph; ``current`` and
    ``desired`` are unit rays in axes of the cameras (right, down, forward), shape (N, 3), with the
    distortion of the lens removed; ``noise``, shape (N, 2), is the deviation of the angle of each
    current and desired ray [rad].
    """

    ids: IntArray
    current: FloatArray
    desired: FloatArray
    noise: FloatArray

    def __post_init__(self) -> None:
        count = len(np.asarray(self.ids).reshape(-1))
        shapes = {'current': (count, 3), 'desired': (count, 3), 'noise': (count, 2)}
        object.__setattr__(self, 'ids', frozen(np.asarray(self.ids, np.int64).reshape(-1)))
        for name, shape in shapes.items():
            object.__setattr__(self, name, _checked(getattr(self, name), name, shape))
        different = len(set(self.ids.tolist()))
        if different != count:
            raise ValueError(
                f'ids must differ, got {count} of which {different} do; '
                'pass one row for each feature'
            )
        if not (self.noise > 0.0).all():
            raise ValueError(
                f'noise must be positive, got {self.noise.min():g}; '
                'pass the deviation of the angle of each ray [rad]'
            )

    def __len__(self) -> int:
        return len(self.ids)

    def take(self, rows: BoolArray) -> 'FeatureObservations':
        """Return the rows chosen by a mask, shape (N,)."""
        if rows.all():
            return self
        return FeatureObservations(
            self.ids[rows], self.current[rows], self.desired[rows], self.noise[rows]
        )


def _checked(array: Any, name: str, shape: tuple[int, int]) -> FloatArray:
    values = np.asarray(array, np.float64)
    if values.shape != shape:
        raise ValueError(
            f'{name} must have shape {shape} to match ids, got {values.shape}; '
            'pass one row for each feature'
        )
    finite = np.isfinite(values).all(axis=1)
    if not finite.all():
        bad = int((~finite).sum())
        raise ValueError(f'{name} must be finite, got {bad} rows with NaN or inf; drop them')
    return np.asarray(frozen(values))


@dataclass(frozen=True, slots=True, kw_only=True)
class MapSettings:
    """
    Bounds of the map.

    ``keyframes`` and ``features`` that it holds at most; ``steps``, iterations a frame when a
    keyframe is new; ``keyframe_spacing``, the least way between keyframes, in depths of the scene;
    ``scale_deviation`` of the logarithm of the true way over the commanded or measured one;
    ``lag``, the way by which a base may be behind those [m].
    """

    keyframes: int = 14
    features: int = 120
    steps: int = 2
    keyframe_spacing: float = 0.03
    scale_deviation: float = 0.05
    lag: float = 0.02


def tangent_basis_of(rays: FloatArray, noise: FloatArray) -> FloatArray:
    """Return two vectors across rays, (N, 3), one over the noise (N,) long: shape (2, 3, N)."""
    tangent_basis = np.empty((2, 3, len(rays)))
    for side, parts in zip(tangent_basis, tangents(*rays.T), strict=True):
        for row, part in zip(side, parts, strict=True):
            np.divide(part, noise, out=row)
    return tangent_basis


def differ_in_place(last: FeatureObservations, now: FeatureObservations) -> bool:
    """Whether two views differ by more than a turn."""
    _, rows, others = np.intersect1d(last.ids, now.ids, assume_unique=True, return_indices=True)
    before, after = last.current[rows], now.current[others]
    if len(before) < MIN_POINTS:
        return True
    return fit_rotation(after, before).parallax > COLLECTED_PARALLAX * median(now.noise[:, 0])
