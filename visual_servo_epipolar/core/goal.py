"""Goal: the pose to come back to, which a photograph defines, and the map around it."""

from dataclasses import dataclass, replace
from typing import Any, Generic, TypeVar
from zlib import crc32

from visual_servo_epipolar.core.arrays import Image

NO_GOAL = 0  # id of no goal, or of an unnamed one
MapT = TypeVar('MapT')


@dataclass(frozen=True)
class Goal(Generic[MapT]):
    """
    Goal of a run: its ``id``, which each of its features carries.

    The ``map`` of what lies around is the servo's, and is learnt anew for each goal.
    """

    id: int = NO_GOAL
    map: MapT | None = None

    def differs(self, other: int) -> bool:
        """Return whether features of the goal ``other`` lead elsewhere; NO_GOAL is any."""
        return NO_GOAL not in (self.id, other) and other != self.id

    def followed_by(self, other: int) -> 'Goal[Any]':
        """Return the goal after features of ``other``: another one has no map yet."""
        if other in (NO_GOAL, self.id):
            return self
        return Goal(other) if self.differs(other) else replace(self, id=other)


def goal_id(image: Image) -> int:
    """Return the id of the goal that a photograph defines, never NO_GOAL."""
    return crc32(image.tobytes()) or NO_GOAL + 1
