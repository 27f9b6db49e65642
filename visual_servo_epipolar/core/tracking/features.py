"""Features: what the tracker hands to the servo, the rows of the topic ``tracks``."""

from dataclasses import dataclass, field

import numpy as np

from visual_servo_epipolar.core.arrays import as_points, FloatArray, frozen, IntArray

NO_GOAL = 0  # number of no photograph


def _no_points() -> FloatArray:
    return np.empty((0, 2))


@dataclass(frozen=True, slots=True, eq=False)
class Features:
    """
    Features of the desired view in the current image, rows are features.

    ``ids``, shape (N,), never change their meaning within one desired view. ``current`` and
    ``desired``, shape (N, 2), are pixels (u, v) in the two images; ``ages``, shape (N,), frames
    since (re)detection; ``errors``, shape (N,), residuals of the alignment [grey levels].
    """

    ids: IntArray = field(default_factory=lambda: np.empty(0, np.int64))
    current: FloatArray = field(default_factory=_no_points)
    desired: FloatArray = field(default_factory=_no_points)
    ages: IntArray = field(default_factory=lambda: np.empty(0, np.int64))
    errors: FloatArray = field(default_factory=lambda: np.empty(0))

    def __post_init__(self) -> None:
        ids = np.asarray(self.ids, dtype=np.int64).reshape(-1)
        columns = {
            'ids': ids,
            'current': as_points(self.current, 'current'),
            'desired': as_points(self.desired, 'desired'),
            'ages': np.asarray(self.ages, dtype=np.int64).reshape(-1),
            'errors': np.asarray(self.errors, dtype=np.float64).reshape(-1),
        }
        for name, column in columns.items():
            if len(column) != len(ids):
                raise ValueError(
                    f'{name} must have {len(ids)} rows to match ids, got {len(column)}; '
                    'pass one row for each feature'
                )
            object.__setattr__(self, name, frozen(column))

    @classmethod
    def owning(
        cls,
        ids: IntArray,
        current: FloatArray,
        desired: FloatArray,
        ages: IntArray,
        errors: FloatArray,
    ) -> 'Features':
        """
        Return features of columns that fit and that nobody else holds: neither copied nor checked.

        For simulations, where checks and copies would take longer than to make the features.
        """
        features = object.__new__(cls)
        columns = (ids, current, desired, ages, errors)
        for name, column in zip(cls.__slots__, columns, strict=True):
            column.setflags(write=False)
            object.__setattr__(features, name, column)
        return features

    def __len__(self) -> int:
        return len(self.ids)
