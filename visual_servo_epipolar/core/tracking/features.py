"""Features: the rows of the topic ``tracks``, from the tracker to the servo."""

from dataclasses import dataclass, field

import numpy as np

from visual_servo_epipolar.core.arrays import as_points, FloatArray, frozen, IntArray
from visual_servo_epipolar.core.goal import NO_GOAL


def _no_points() -> FloatArray:
    return np.empty((0, 2))


@dataclass(frozen=True, slots=True, eq=False)
class Features:
    """
    Features of the desired view in the current image, rows are features.

    ``ids``, shape (N,), never change their meaning within one desired view. ``current`` and
    ``desired``, shape (N, 2), are pixels (u, v) in the two images; ``ages``, shape (N,), frames
    since (re)detection; ``errors``, shape (N,), residuals of the alignment [grey levels].
    ``goal`` is the id of the goal to which all of them belong.
    """

    ids: IntArray = field(default_factory=lambda: np.empty(0, np.int64))
    current: FloatArray = field(default_factory=_no_points)
    desired: FloatArray = field(default_factory=_no_points)
    ages: IntArray = field(default_factory=lambda: np.empty(0, np.int64))
    errors: FloatArray = field(default_factory=lambda: np.empty(0))
    goal: int = NO_GOAL

    def __post_init__(self) -> None:
        count = np.asarray(self.ids).size
        for name in ('ids', 'current', 'desired', 'ages', 'errors'):
            column = getattr(self, name)
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
            object.__setattr__(self, name, frozen(column))

    def __len__(self) -> int:
        return len(self.ids)
