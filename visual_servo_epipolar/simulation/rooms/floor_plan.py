"""Floor plan: cells of the storey, walls between them, what is seen through their openings."""

from collections.abc import Iterator
from dataclasses import dataclass
from functools import cached_property
import math
from typing import NamedTuple

THICKNESS = 0.12  # of walls [m]
DOOR_HEIGHT = 2.1  # of openings that have a lintel [m]
DOOR = 1.1  # width [m]
WIDEST_DOOR = 1.6  # wider openings reach to the ceiling [m]
SLACK = 0.3  # in an opening one is in both of its cells [m]
DEEPEST = 8  # cells that one looks through

Point = tuple[float, float]


class FloorCell(NamedTuple):
    """A room, or a stretch of corridor: its corners (x0, y0) and (x1, y1) [m]."""

    name: str
    x0: float
    y0: float
    x1: float
    y1: float

    def holds(self, x: float, y: float, slack: float = 0.0) -> bool:
        """Whether a point lies in it, or within ``slack`` [m] of it."""
        within = self.x0 - slack <= x <= self.x1 + slack
        return within and self.y0 - slack <= y <= self.y1 + slack


class WallLine(NamedTuple):
    """A wall along x (at y = ``at``) or along y, with openings: (middle, width) along it [m]."""

    along_x: bool
    at: float
    start: float
    end: float
    openings: tuple[tuple[float, float], ...] = ()

    def pieces(self) -> Iterator[tuple[float, float, float]]:
        """Yield start, end and bottom of each solid piece [m]: lintels hang above doors."""
        start = self.start
        for middle, width in sorted(self.openings):
            left, right = middle - 0.5 * width, middle + 0.5 * width
            yield start, left, 0.0
            if width <= WIDEST_DOOR:
                yield left, right, DOOR_HEIGHT
            start = right
        yield start, self.end, 0.0

    def place(self, along: float) -> Point:
        """Return the point ``along`` the wall [m]."""
        return (along, self.at) if self.along_x else (self.at, along)


class Opening(NamedTuple):
    """An opening between two cells, from one end to the other."""

    cells: tuple[str, str]
    ends: tuple[Point, Point]


@dataclass(frozen=True)
class FloorPlan:
    """Cells and the walls between them; what lies beyond the cells is never seen."""

    cells: tuple[FloorCell, ...]
    walls: tuple[WallLine, ...]

    @cached_property
    def openings(self) -> tuple[Opening, ...]:
        """All openings, with the cells on either side."""
        found = []
        for wall in self.walls:
            for middle, width in wall.openings:
                ends = wall.place(middle - 0.5 * width), wall.place(middle + 0.5 * width)
                x, y = wall.place(middle)
                beside = self.cells_at(x, y, 0.5 * THICKNESS)
                if len(beside) == 2:
                    found.append(Opening((beside[0], beside[1]), ends))
        return tuple(found)

    def cells_at(self, x: float, y: float, slack: float = SLACK) -> list[str]:
        """Return the names of the cells that hold a point, both where it is in an opening."""
        return [cell.name for cell in self.cells if cell.holds(x, y, slack)]

    def is_near_opening(self, x: float, y: float, clear: float) -> bool:
        """Return whether a point is in the way of an opening: ``clear`` [m] beside it."""
        for opening in self.openings:
            (x0, y0), (x1, y1) = opening.ends
            reach = clear + 0.5 * math.hypot(x1 - x0, y1 - y0)
            if math.hypot(0.5 * (x0 + x1) - x, 0.5 * (y0 + y1) - y) < reach:
                return True
        return False

    def seen_from(self, x: float, y: float) -> frozenset[str]:
        """Return the names of the cells of which something may be seen from a point."""
        seen: set[str] = set()
        for name in self.cells_at(x, y):
            self._look(name, (x, y), None, (name,), seen)
        return frozenset(seen)

    def _look(
        self,
        name: str,
        eye: Point,
        wedge: tuple[Point, Point] | None,
        way: tuple[str, ...],
        seen: set[str],
    ) -> None:
        """Add the cell and those seen through its openings, within a ``wedge`` (right, left)."""
        seen.add(name)
        for opening in self.openings if len(way) < DEEPEST else ():
            if name not in opening.cells:
                continue
            other = opening.cells[opening.cells[0] == name]
            if other in way:
                continue
            narrowed = _narrowed(eye, wedge, opening.ends)
            if narrowed is not None:
                self._look(other, eye, narrowed, (*way, other), seen)


def _narrowed(
    eye: Point, wedge: tuple[Point, Point] | None, ends: tuple[Point, Point]
) -> tuple[Point, Point] | None:
    """Return what of a ``wedge`` of view goes through an opening, None if nothing does."""
    right, left = ((x - eye[0], y - eye[1]) for x, y in ends)
    if _cross(right, left) < 0.0:
        right, left = left, right
    if wedge is not None:
        right = wedge[0] if _cross(right, wedge[0]) > 0.0 else right
        left = wedge[1] if _cross(wedge[1], left) > 0.0 else left
    return (right, left) if _cross(right, left) > 0.0 else None


def _cross(first: Point, second: Point) -> float:
    """Return the sine of the turn to the left from one direction to another, times lengths."""
    return first[0] * second[1] - first[1] * second[0]


PLAN = FloorPlan(
    (
        FloorCell('south', -2.4, -2.4, 16.4, 0.0),
        FloorCell('north', -2.4, 9.0, 16.4, 11.4),
        FloorCell('west', -2.4, 0.0, 0.0, 9.0),
        FloorCell('east', 14.0, 0.0, 16.4, 9.0),
        FloorCell('library', 0.0, 0.0, 7.0, 9.0),
        FloorCell('workshop', 7.0, 0.0, 14.0, 9.0),
        FloorCell('office', 0.0, -8.4, 7.0, -2.4),
        FloorCell('store', 7.0, -8.4, 14.0, -2.4),
    ),
    (
        WallLine(True, -8.4, 0.0, 14.0),
        WallLine(True, -2.4, -2.4, 16.4, ((3.0, DOOR), (11.0, DOOR))),
        WallLine(True, 0.0, -2.4, 16.4, ((-1.2, 2.4), (4.5, DOOR), (9.5, DOOR), (15.2, 2.4))),
        WallLine(True, 9.0, -2.4, 16.4, ((-1.2, 2.4), (2.5, DOOR), (11.5, DOOR), (15.2, 2.4))),
        WallLine(True, 11.4, -2.4, 16.4),
        WallLine(False, -2.4, -2.4, 11.4),
        WallLine(False, 0.0, -8.4, -2.4),
        WallLine(False, 0.0, 0.0, 9.0),
        WallLine(False, 7.0, -8.4, -2.4, ((-5.5, DOOR),)),
        WallLine(False, 7.0, 0.0, 9.0, ((6.0, DOOR),)),
        WallLine(False, 14.0, -8.4, -2.4),
        WallLine(False, 14.0, 0.0, 9.0),
        WallLine(False, 16.4, -2.4, 11.4),
    ),
)
