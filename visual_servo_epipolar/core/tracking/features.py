"""Features: what the tracker hands to the servo, the rows of the topic ``tracks``."""

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

FIRST_PASSING = 1 << 24  # least id of a feature that no photograph shows


def _no_points() -> FloatArray:
    return np.empty((0, 2))


def _set_columns(features: Any, columns: dict[str, Any], count: int) -> None:
    """Set frozen columns of ``count`` rows; ValueError naming the one that has others."""
    for name, column in columns.items():
        if len(column) != count:
            raise ValueError(
                f'{name} must have {count} rows to match ids, got {len(column)}; '
                'pass one row for each feature'
            )
        object.__setattr__(features, name, frozen(column))


@dataclass(frozen=True, slots=True, eq=False)
class Passing:
    """
    Features of the current image that the photograph does not show, rows are features.

    ``ids``, shape (M,), are no ids of its features; ``current``, shape (M, 2), are pixels (u, v);
    ``ages``, shape (M,), frames since detection.
    """

    ids: IntArray = field(default_factory=lambda: np.empty(0, np.int64))
    current: FloatArray = field(default_factory=_no_points)
    ages: IntArray = field(default_factory=lambda: np.empty(0, np.int64))

    def __post_init__(self) -> None:
        ids = np.asarray(self.ids, dtype=np.int64).reshape(-1)
        columns = {
            'ids': ids,
            'current': as_points(self.current, 'current'),
            'ages': np.asarray(self.ages, dtype=np.int64).reshape(-1),
        }
        _set_columns(self, columns, len(ids))

    def __len__(self) -> int:
        return len(self.ids)

    def take(self, rows: BoolArray) -> 'Passing':
        """Return the rows chosen by a mask, shape (M,)."""
        return Passing(self.ids[rows], self.current[rows], self.ages[rows])


NOTHING_PASSING = Passing()


@dataclass(frozen=True, slots=True, eq=False)
class Features:
    """
    Features of the desired view in the current image, rows are features.

    ``ids``, shape (N,), never change their meaning within one desired view. ``current`` and
    ``desired``, shape (N, 2), are pixels (u, v) in the two images; ``ages``, shape (N,), frames
    since (re)detection; ``errors``, shape (N,), residuals of the alignment [grey levels].
    ``passing`` are features that the photograph does not show; they do not count. ``goal`` is the
    id of the goal to which all of them belong.
    """

    ids: IntArray = field(default_factory=lambda: np.empty(0, np.int64))
    current: FloatArray = field(default_factory=_no_points)
    desired: FloatArray = field(default_factory=_no_points)
    ages: IntArray = field(default_factory=lambda: np.empty(0, np.int64))
    errors: FloatArray = field(default_factory=lambda: np.empty(0))
    passing: Passing = NOTHING_PASSING
    goal: int = NO_GOAL

    def __post_init__(self) -> None:
        ids = np.asarray(self.ids, dtype=np.int64).reshape(-1)
        columns = {
            'ids': ids,
            'current': as_points(self.current, 'current'),
            'desired': as_points(self.desired, 'desired'),
            'ages': np.asarray(self.ages, dtype=np.int64).reshape(-1),
            'errors': np.asarray(self.errors, dtype=np.float64).reshape(-1),
        }
        _set_columns(self, columns, len(ids))

    @classmethod
    def owning(
        cls,
        ids: IntArray,
        current: FloatArray,
        desired: FloatArray,
        ages: IntArray,
        errors: FloatArray,
        passing: Passing = NOTHING_PASSING,
        goal: int = NO_GOAL,
    ) -> 'Features':
        """
        Return features of columns that fit and that nobody will write: neither copied nor checked.

        For the tracker and simulations, whose columns are right as they are made.
        """
        features = object.__new__(cls)
        columns = (ids, current, desired, ages, errors)
        for name, column in zip(cls.__slots__[: len(columns)], columns, strict=True):
            column.setflags(write=False)
            object.__setattr__(features, name, column)
        object.__setattr__(features, 'passing', passing)
        object.__setattr__(features, 'goal', goal)
        return features

    def __len__(self) -> int:
        return len(self.ids)
