"""Features: what the tracker hands to the servo, the rows of the topic ``tracks``."""

from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from visual_servo_epipolar.core.arrays import (
    as_points,
    BoolArray,
    FloatArray,
    frozen,
    IntArray,
)
from visual_servo_epipolar.core.goal import NO_GOAL

FIRST_AUXILIARY = 1 << 24  # least id of a feature that no photograph shows


def _no_points() -> FloatArray:
    return np.empty((0, 2))


def _freeze_columns(features: Any, names: Sequence[str]) -> None:
    """Convert and freeze columns, ids first; ValueError naming one that does not fit."""
    count = np.asarray(features.ids).size
    for name in names:
        column = getattr(features, name)
        if name in ('current', 'desired'):
            column = as_points(column, name)
        else:
            kind = np.float64 if name == 'errors' else np.int64
            column = np.asarray(column, dtype=kind).reshape(-1)
        if len(column) != count:
            raise ValueError(
                f'{name} must have {count} rows to match ids, got {len(column)}; '
                'pass one row for each feature'
            )
        object.__setattr__(features, name, frozen(column))


@dataclass(frozen=True, slots=True, eq=False)
class AuxiliaryFeatures:
    """
    Features of the current image that the photograph does not show, rows are features.

    ``ids``, shape (M,), are no ids of its features; ``current``, shape (M, 2), are pixels (u, v);
    ``ages``, shape (M,), frames since detection.
    """

    ids: IntArray = field(default_factory=lambda: np.empty(0, np.int64))
    current: FloatArray = field(default_factory=_no_points)
    ages: IntArray = field(default_factory=lambda: np.empty(0, np.int64))

    def __post_init__(self) -> None:
        _freeze_columns(self, self.__slots__)

    def __len__(self) -> int:
        return len(self.ids)

    def take(self, rows: BoolArray) -> 'AuxiliaryFeatures':
        """Return the rows chosen by a mask, shape (M,)."""
        return AuxiliaryFeatures(self.ids[rows], self.current[rows], self.ages[rows])


NO_AUXILIARY = AuxiliaryFeatures()


@dataclass(frozen=True, slots=True, eq=False)
class Features:
    """
    Features of the desired view in the current image, rows are features.

    ``ids``, shape (N,), never change their meaning within one desired view. ``current`` and
    ``desired``, shape (N, 2), are pixels (u, v) in the two images; ``ages``, shape (N,), frames
    since (re)detection; ``errors``, shape (N,), residuals of the alignment [grey levels].
    ``auxiliary`` features are not in the photograph; they do not count. ``goal`` is the
    id of the goal to which all of them belong.
    """

    ids: IntArray = field(default_factory=lambda: np.empty(0, np.int64))
    current: FloatArray = field(default_factory=_no_points)
    desired: FloatArray = field(default_factory=_no_points)
    ages: IntArray = field(default_factory=lambda: np.empty(0, np.int64))
    errors: FloatArray = field(default_factory=lambda: np.empty(0))
    auxiliary: AuxiliaryFeatures = NO_AUXILIARY
    goal: int = NO_GOAL

    def __post_init__(self) -> None:
        _freeze_columns(self, ('ids', 'current', 'desired', 'ages', 'errors'))

    @classmethod
    def owning(
        cls,
        ids: IntArray,
        current: FloatArray,
        desired: FloatArray,
        ages: IntArray,
        errors: FloatArray,
        auxiliary: AuxiliaryFeatures = NO_AUXILIARY,
        goal: int = NO_GOAL,
    ) -> 'Features':
        """
        Return features of columns that fit and that nobody will write: neither copied nor checked.

        For the tracker and simulations, whose columns are right as they are made.
        """
        features, columns = object.__new__(cls), (ids, current, desired, ages, errors)
        for column in columns:
            column.setflags(write=False)
        for name, value in zip(cls.__slots__, (*columns, auxiliary, goal), strict=True):
            object.__setattr__(features, name, value)
        return features

    def __len__(self) -> int:
        return len(self.ids)
