"""Storey: a ring of corridors around two rooms, two more beside it; what may change in it."""

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, replace
from functools import cached_property
import math
from typing import NamedTuple

import numpy as np

from visual_servo_epipolar.core.arrays import FloatArray
from visual_servo_epipolar.simulation.light import (
    FURNITURE,
    Lamp,
    LAMPS,
    Light,
    LIGHTS,
    PICTURES,
    RoomChange,
    STOREY,
    UNCHANGED,
    Window,
)
from visual_servo_epipolar.simulation.rendering.surfaces import ROOM, Scene, Surface
from visual_servo_epipolar.simulation.rooms import materials as m
from visual_servo_epipolar.simulation.rooms.building import (
    Builder,
    Furniture,
    HEIGHT,
    Painting,
    Panel,
)
from visual_servo_epipolar.simulation.rooms.materials import poster

THICKNESS = 0.12  # of walls [m]
DOOR = 1.1  # width [m]
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
            if width <= 1.6:  # wider openings reach to the ceiling [m]
                yield left, right, 2.1  # of openings that have a lintel [m]
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


Cells = frozenset[str]
PARTS: Mapping[str, tuple[str, ...]] = {
    LAMPS: (LAMPS,),
    PICTURES: (PICTURES,),
    FURNITURE: (FURNITURE,),
    STOREY: (LAMPS, PICTURES, FURNITURE),
}
SHARE = 1.0 / 3.0  # of the lamps that are off, of the pictures that are others, of what is moved
SHIFT = (0.1, 0.35)  # of a piece of furniture along its wall [m]
CHAIR, CHAIRS = (0.45, 0.42, 0.85), 2  # its size [m], and how many a cell has
OFF = 165.0  # grey of a lamp that is off
# Cells with a window in an outer wall: its middle [m], the normal into the cell.
WINDOWS: Mapping[str, tuple[tuple[float, float], tuple[float, float]]] = {
    'office': ((4.6, -8.34), (0.0, 1.0)),
    'store': ((9.4, -8.34), (0.0, 1.0)),
    'north': ((5.0, 11.34), (0.0, -1.0)),
    'west': ((-2.34, 5.2), (1.0, 0.0)),
    'east': ((16.34, 4.0), (-1.0, 0.0)),
}


@dataclass(eq=False)
class ChangedStorey:
    """
    A storey with a ``change``: its ``builder``, its ``light``, and what lights each cell besides.

    ``cells`` of a panel of the shell or of a body, by name, are those in which it can be seen.
    """

    builder: Builder
    light: Light
    cells: dict[str, Cells]
    sources: dict[str, tuple[Lamp | Window, ...]]

    def surfaces(self) -> list[tuple[Surface, Cells]]:
        """Return all surfaces, panes of windows the last, and the cells of each."""
        builder, found = self.builder, []
        lamps, boxes = builder.places_of_lamps, builder.boxes
        for panel in builder.panels:
            cells = self.cells[panel.name if panel.body == ROOM else panel.body]
            found.append((panel.lit(self._light_in(cells), lamps, boxes), cells))
        for cell in self.sources:
            for pane in builder.panes(self._light_in(frozenset([cell]))):
                name = f'{cell} {pane.name}'
                found.append((replace(pane, name=name, body=name), frozenset([cell])))
        return found

    def _light_in(self, cells: Cells) -> Light:
        sources = [each for cell in sorted(cells) for each in self.sources.get(cell, ())]
        return replace(self.light, sources=(*self.light.sources, *sources))


def changed_storey(
    builder: Builder, cells: Mapping[str, Cells], light: Light, change: RoomChange
) -> ChangedStorey:
    """Return the storey that a ``builder`` built, by a ``light``, after the ``change``."""
    parts = PARTS.get(change.name, ()) if change.has_changed else ()
    storey = ChangedStorey(builder, light, dict(cells), {})
    for number, (name, apply) in enumerate(APPLIED.items()):
        if name in parts:
            storey.builder = storey.builder.copied(np.random.default_rng((change.seed, number)))
            apply(storey)
    return storey


def _switch_lamps(storey: ChangedStorey) -> None:
    """Switch a third of the lamps off, stand a lamp into most cells, let day in at windows."""
    builder, light = storey.builder, storey.light
    rng = builder.rng
    is_off = rng.uniform(size=len(builder.lamps)) < SHARE
    off = [lamp for lamp, each in zip(builder.lamps, is_off, strict=True) if each]
    builder.lamps = [lamp for lamp, each in zip(builder.lamps, is_off, strict=True) if not each]
    builder.panels = [_with_lamps_off(panel, off, rng) for panel in builder.panels]
    ambient, ceiling = rng.uniform((0.4, 0.7), (1.1, 1.6)).tolist()
    storey.light = replace(light, ambient=ambient * light.ambient, ceiling=ceiling * light.ceiling)
    for cell in PLAN.cells:
        low, high = (cell.x0 + 0.5, cell.y0 + 0.5, 1.4), (cell.x1 - 0.5, cell.y1 - 0.5, 2.2)
        x, y, z = rng.uniform(low, high).tolist()
        lamp, window = Lamp((x, y, z), float(rng.uniform(1.0, 3.0))), WINDOWS.get(cell.name)
        sources: tuple[Lamp | Window, ...] = (lamp,) if rng.uniform() < 0.7 else ()
        if window is not None:
            sources += (_window(*window, rng),)
        storey.sources[cell.name] = sources


def _with_lamps_off(
    panel: Panel, off: list[tuple[float, float]], rng: np.random.Generator
) -> Panel:
    """Return a panel with the lamps that are ``off`` painted grey, where it is a ceiling."""
    (x0, y0, _), across, down = panel.frame
    here = [(x - x0, y - y0) for x, y in off]
    here = [(x, y) for x, y in here if 0.0 < x < across[0] and 0.0 < y < down[1]]
    if not panel.name.endswith('ceiling') or not here:
        return panel
    sheet = panel.sheet.copied(rng)
    for x, y in here:
        sheet.rect(x - 0.6, y - 0.15, 1.2, 0.3, OFF)
    return replace(panel, sheet=sheet)


def _window(
    middle: tuple[float, float], normal: tuple[float, float], rng: np.random.Generator
) -> Window:
    sky, sun, aside, up = rng.uniform((3.0, 0.0, -0.6, 0.3), (8.0, 0.8, 0.6, 0.9)).tolist()
    (x, y), (nx, ny) = middle, normal
    sun_from = (-nx - aside * ny, -ny + aside * nx, up)
    return Window((x, y, 1.75), (2.2, 1.3), sky, sun, sun_from, (nx, ny, 0.0))


def _exchange_pictures(storey: ChangedStorey) -> None:
    """Hang other pictures over a third of those on walls and boards, each where one hung."""
    builder = storey.builder
    for number, panel in enumerate(builder.panels):
        out = [each for each in panel.sheet.pictures if builder.rng.uniform() < SHARE]
        if out:
            sheet = panel.sheet.copied(builder.rng)
            for place in out:
                poster(sheet, *place)
            builder.panels[number] = replace(panel, sheet=sheet)


def _move_furniture(storey: ChangedStorey) -> None:
    """Move a third of the furniture along its walls, and put chairs where none stood."""
    builder = storey.builder
    rng = builder.rng
    names = {cell.name for cell in PLAN.cells}
    for piece in [*builder.standing]:
        is_furniture = piece.name.split(' ')[0] in names and piece.bottom == 0.0
        if is_furniture and rng.uniform() < SHARE:
            side = 1.0 if rng.uniform() < 0.5 else -1.0
            builder.move(piece, side * float(rng.uniform(*SHIFT)) * piece.axes()[0][:2])
    for cell in PLAN.cells:
        for number in range(CHAIRS):
            chair = _chair(cell, f'{cell.name} chair {number}', rng)
            storey.cells[chair.name] = frozenset([cell.name])
            builder.stand(chair)


def _chair(cell: FloorCell, name: str, rng: np.random.Generator) -> Furniture:
    """Return a chair near one of the longer walls of a cell, out of the way."""
    width, depth = cell.x1 - cell.x0, cell.y1 - cell.y0
    is_narrow, along_x = min(width, depth) < 3.0, width > 2.0 * depth
    while True:
        off = 0.35 if is_narrow else float(rng.uniform(0.6, 0.9))
        along, side, turn = rng.uniform((0.15, -1.0, -np.pi), (0.85, 1.0, np.pi)).tolist()
        x, y = cell.x0 + along * width, cell.y0 + along * depth
        if along_x:
            y = cell.y0 + off if side < 0.0 else cell.y1 - off
        else:
            x = cell.x0 + off if side < 0.0 else cell.x1 - off
        if not PLAN.is_near_opening(x, y, 0.7):  # a chair is smaller than a shelf
            return Furniture(name, x, y, CHAIR, m.crate, m.timber, turn=turn)


APPLIED = {LAMPS: _switch_lamps, PICTURES: _exchange_pictures, FURNITURE: _move_furniture}


CORRIDORS = ('south', 'north', 'west', 'east')
LAMP_SPACING = 3.6  # at most [m]
PITCH = 1.75  # from one piece of furniture along a wall to the next [m]
CLEAR, FROM_CORNER = 0.85, 1.05  # of furniture beside an opening, and in corners [m]
FRONTS = (m.bookcase, m.cupboard, m.crate, m.noticeboard)


@dataclass(frozen=True, eq=False)
class StoreyScene(Scene):
    """All surfaces of a storey; ``cells`` of each are those in which it can be seen."""

    cells: tuple[frozenset[str], ...] = ()

    @cached_property
    def _parts(self) -> dict[frozenset[str], Scene]:
        return {}

    def seen_from(self, centre: FloatArray) -> Scene:
        """Return the surfaces of the cells that are seen from ``centre``, shape (3,)."""
        seen = PLAN.seen_from(float(centre[0]), float(centre[1]))
        if not seen:
            return self
        if seen not in self._parts:
            surfaces = zip(self.surfaces, self.cells, strict=True)
            self._parts[seen] = Scene(tuple(each for each, cells in surfaces if cells & seen))
        return self._parts[seen]


class Storey:
    """The storey of a seed, and how it looks by the light that was asked for last."""

    def __init__(self, seed: int) -> None:
        lamps = [lamp for cell in PLAN.cells for lamp in _lamps(cell)]
        self._builder = Builder(np.random.default_rng((seed, 99)), lamps, 0.0)
        self._cells: dict[str, frozenset[str]] = {}  # by panel or body
        self._scenes: dict[tuple[str, RoomChange], StoreyScene] = {}
        self._build()

    def by(self, light: str, change: RoomChange = UNCHANGED) -> StoreyScene:
        """Return the storey by the light of that name, as a room, with a change; one is kept."""
        key = light, change
        if key not in self._scenes:
            self._scenes = {}  # two do not fit into small machines
            storey = changed_storey(self._builder, self._cells, LIGHTS[light], change)
            surfaces, cells = zip(*storey.surfaces(), strict=True)
            self._scenes = {key: StoreyScene(surfaces, cells=cells)}
        return self._scenes[key]

    def _build(self) -> None:
        for cell in PLAN.cells:
            pieces = [*_along_walls(cell, self._builder.rng), *_signs(cell)]
            self._lay(cell, pieces)
            for piece in pieces:
                self._cells[piece.name] = frozenset([cell.name])
                self._builder.stand(piece)
        for number, wall in enumerate(PLAN.walls):
            for start, end, bottom in wall.pieces():
                if end - start > 0.02:  # of a wall [m]
                    self._put_up(f'wall {number} {start:g}', wall, (start, end, bottom))

    def _lay(self, cell: FloorCell, pieces: list[Furniture]) -> None:
        """Lay floor and ceiling of a cell."""
        width, depth = cell.x1 - cell.x0, cell.y1 - cell.y0
        right, far = np.array([width, 0.0, 0.0]), np.array([0.0, depth, 0.0])
        floor = (np.array([cell.x0, cell.y1, 0.0]), right, -far)
        ceiling = (np.array([cell.x0, cell.y0, HEIGHT]), right, far)
        lamps = [(x - cell.x0, y - cell.y0) for x, y in _lamps(cell)]
        standing = [piece for piece in pieces if piece.bottom < 0.3]
        paint = m.concrete if cell.name in CORRIDORS else m.planks
        names = f'{cell.name} floor', f'{cell.name} ceiling'
        self._builder.panel(names[0], ROOM, floor, paint, density=150.0, standing=standing)
        self._builder.panel(
            names[1], ROOM, ceiling, lambda sheet: m.ceiling(sheet, lamps), density=120.0
        )
        for name in names:
            self._cells[name] = frozenset([cell.name])

    def _put_up(self, name: str, wall: WallLine, piece: tuple[float, float, float]) -> None:
        """Put up a solid piece of a wall: start, end and bottom."""
        start, end, bottom = piece
        if not wall.along_x:  # walls along x go through where two meet
            start, end = start + 0.5 * THICKNESS, end - 0.5 * THICKNESS
        x, y = wall.place(0.5 * (start + end))
        half = 0.5 * THICKNESS
        x, y, turn = (x, y - half, 0.0) if wall.along_x else (x + half, y, 0.5 * math.pi)
        size = (end - start, THICKNESS, HEIGHT - bottom)
        self._builder.stand(
            Furniture(name, x, y, size, _face, _face, bottom=bottom, turn=turn),
            density=180.0,  # texels a metre
        )
        ends = wall.place(start), wall.place(end)
        low, high = np.min(ends, axis=0) - 0.1, np.max(ends, axis=0) + 0.1
        self._cells[name] = frozenset(
            cell.name
            for cell in PLAN.cells
            if cell.x0 < high[0] and cell.x1 > low[0] and cell.y0 < high[1] and cell.y1 > low[1]
        )


def _lamps(cell: FloorCell) -> list[tuple[float, float]]:
    """Return where lamps hang in a cell, evenly."""
    columns = math.ceil((cell.x1 - cell.x0) / LAMP_SPACING)
    rows = math.ceil((cell.y1 - cell.y0) / LAMP_SPACING)
    x = cell.x0 + (np.arange(columns) + 0.5) * (cell.x1 - cell.x0) / columns
    y = cell.y0 + (np.arange(rows) + 0.5) * (cell.y1 - cell.y0) / rows
    return [(float(a), float(b)) for a in x for b in y]


def _face(sheet: Painting, grey: float) -> None:
    """Paint a face of a wall: with pictures where it is large, plain at its ends."""
    if sheet.width < 0.5 or sheet.height < 2.0:
        sheet.fill(150.0 + 0.2 * grey)
        sheet.roughen(4.0)
        return
    span = max(1, round(sheet.width / 1.15))
    fittings = ''.join(sheet.rng.choice(list('ppppwdb'), span).tolist())
    m.wall(sheet, fittings=fittings)


def _signs(cell: FloorCell) -> list[Furniture]:
    """Return signs that hang across a corridor, above the head of the robot."""
    if cell.name not in CORRIDORS:
        return []
    x, y = 0.5 * (cell.x0 + cell.x1), 0.5 * (cell.y0 + cell.y1)
    along_x = cell.x1 - cell.x0 > cell.y1 - cell.y0
    half = 0.25 * max(cell.x1 - cell.x0, cell.y1 - cell.y0)
    size, turn = (1.1, 0.03, 0.42), 0.5 * math.pi if along_x else 0.0
    places = [(x - half, y), (x + half, y)] if along_x else [(x, y - half), (x, y + half)]
    return [
        Furniture(f'{cell.name} sign {k}', *at, size, m.noticeboard, m.noticeboard, 2.2, turn)
        for k, at in enumerate(places)
    ]


def _along_walls(cell: FloorCell, rng: np.random.Generator) -> list[Furniture]:
    """Place furniture along the walls of a cell, little and shallow in corridors."""
    pieces: list[Furniture] = []
    is_corridor = cell.name in CORRIDORS
    for side in ('south', 'north', 'west', 'east'):
        across = side in ('south', 'north')
        start, end = (cell.x0, cell.x1) if across else (cell.y0, cell.y1)
        for along in np.arange(start + FROM_CORNER, end - FROM_CORNER, PITCH).tolist():
            along += float(rng.uniform(-0.15, 0.15))
            width, depth, height = rng.uniform((0.8, 0.3, 0.6), (1.4, 0.5, 2.1)).tolist()
            front = FRONTS[int(rng.integers(len(FRONTS)))]
            is_left_out = float(rng.uniform()) > (0.25 if is_corridor else 0.75)
            depth = 0.22 if is_corridor else depth
            at, turn = _beside(cell, side, along, depth + 0.5 * THICKNESS + 0.02)
            if is_left_out or PLAN.is_near_opening(*at, CLEAR):
                continue
            name, size = f'{cell.name} {side} {along:.2f}', (width, depth, height)
            pieces.append(Furniture(name, *at, size, front, m.timber, turn=turn))
    return pieces


def _beside(
    cell: FloorCell, side: str, along: float, depth: float
) -> tuple[tuple[float, float], float]:
    """Return the place ``depth`` from a wall, and the turn with which a front looks away."""
    return {
        'south': ((along, cell.y0 + depth), math.pi),
        'north': ((along, cell.y1 - depth), 0.0),
        'west': ((cell.x0 + depth, along), 0.5 * math.pi),
        'east': ((cell.x1 - depth, along), -0.5 * math.pi),
    }[side]
