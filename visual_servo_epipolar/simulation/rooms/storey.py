"""Storey: a ring of corridors around two rooms, two more beside it; what may change in it."""

from collections.abc import Iterator, Mapping
from dataclasses import replace
import math
from typing import NamedTuple

import numpy as np

from visual_servo_epipolar.simulation.light import Lamp, Light, UNCHANGED, Window
from visual_servo_epipolar.simulation.rendering.surfaces import Scene
from visual_servo_epipolar.simulation.rooms import materials as m
from visual_servo_epipolar.simulation.rooms.building import (
    Builder,
    FloorCell,
    Furniture,
    HEIGHT,
    Painting,
    Panel,
)

THICKNESS = 0.12  # of walls [m]
DOOR = 1.1  # width [m]

Point = tuple[float, float]


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


# Cells and the walls between them; what lies beyond the cells is never seen.
CELLS = (
    FloorCell('south', -2.4, -2.4, 16.4, 0.0),
    FloorCell('north', -2.4, 9.0, 16.4, 11.4),
    FloorCell('west', -2.4, 0.0, 0.0, 9.0),
    FloorCell('east', 14.0, 0.0, 16.4, 9.0),
    FloorCell('library', 0.0, 0.0, 7.0, 9.0),
    FloorCell('workshop', 7.0, 0.0, 14.0, 9.0),
    FloorCell('office', 0.0, -8.4, 7.0, -2.4),
    FloorCell('store', 7.0, -8.4, 14.0, -2.4),
)
WALLS = (
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
)


def is_near_opening(x: float, y: float, clear: float) -> bool:
    """Return whether a point is in the way of an opening: ``clear`` [m] beside it."""
    return any(
        math.dist(wall.place(middle), (x, y)) < clear + 0.5 * width
        for wall in WALLS
        for middle, width in wall.openings
    )


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


def changed(builder: Builder, seed: int) -> Builder:
    """Return a storey with other lamps and windows, a third other pictures and furniture."""
    for number, change in enumerate((_switch_lamps, _exchange_pictures, _move_furniture)):
        builder = builder.copied(np.random.default_rng((seed, number)))
        change(builder)
    return builder


def _switch_lamps(builder: Builder) -> None:
    """Switch a third of the lamps off, stand a lamp into most cells, let day in at windows."""
    rng = builder.rng
    is_off = rng.uniform(size=len(builder.lamps)) < SHARE
    off = [lamp for lamp, each in zip(builder.lamps, is_off, strict=True) if each]
    builder.lamps = [lamp for lamp, each in zip(builder.lamps, is_off, strict=True) if not each]
    builder.panels = [_with_lamps_off(panel, off, rng) for panel in builder.panels]
    ambient, ceiling = rng.uniform((0.4, 0.7), (1.1, 1.6)).tolist()
    builder.dimmed = ambient, ceiling
    for cell in CELLS:
        low, high = (cell.x0 + 0.5, cell.y0 + 0.5, 1.4), (cell.x1 - 0.5, cell.y1 - 0.5, 2.2)
        x, y, z = rng.uniform(low, high).tolist()
        lamp, window = Lamp((x, y, z), float(rng.uniform(1.0, 3.0))), WINDOWS.get(cell.name)
        sources: tuple[Lamp | Window, ...] = (lamp,) if rng.uniform() < 0.7 else ()
        if window is not None:
            sources += (_window(*window, rng),)
        builder.sources[cell] = sources


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


def _exchange_pictures(builder: Builder) -> None:
    """Hang other pictures over a third of those on walls and boards, each where one hung."""
    for number, panel in enumerate(builder.panels):
        out = [each for each in panel.sheet.pictures if builder.rng.uniform() < SHARE]
        if out:
            sheet = panel.sheet.copied(builder.rng)
            for place in out:
                m.poster(sheet, *place)
            builder.panels[number] = replace(panel, sheet=sheet)


def _move_furniture(builder: Builder) -> None:
    """Move a third of the furniture along its walls, and put chairs where none stood."""
    rng = builder.rng
    names = {cell.name for cell in CELLS}
    for piece in [*builder.standing]:
        is_furniture = piece.name.split(' ')[0] in names and piece.bottom == 0.0
        if is_furniture and rng.uniform() < SHARE:
            side = 1.0 if rng.uniform() < 0.5 else -1.0
            builder.move(piece, side * float(rng.uniform(*SHIFT)) * piece.axes()[0][:2])
    for cell in CELLS:
        for number in range(CHAIRS):
            builder.stand(_chair(cell, f'{cell.name} chair {number}', rng))


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
        if not is_near_opening(x, y, 0.7):  # a chair is smaller than a shelf
            return Furniture(name, x, y, CHAIR, m.crate, m.timber, turn=turn)


CORRIDORS = ('south', 'north', 'west', 'east')
LAMP_SPACING = 3.6  # at most [m]
PITCH = 1.75  # from one piece of furniture along a wall to the next [m]
CLEAR, FROM_CORNER = 0.85, 1.05  # of furniture beside an opening, and in corners [m]


def storey_builder(seed: int) -> Builder:
    """Return the builder of the storey of a seed, with all that stands in it."""
    lamps = [lamp for cell in CELLS for lamp in _lamps(cell)]
    builder = Builder(np.random.default_rng((seed, 99)), lamps)
    for cell in CELLS:
        pieces = [*_along_walls(cell, builder.rng), *_signs(cell)]
        floor = m.concrete if cell.name in CORRIDORS else m.planks
        builder.cover(cell, floor, m.ceiling, pieces, (150.0, 120.0))
        for piece in pieces:
            builder.stand(piece)
    for number, wall in enumerate(WALLS):
        for start, end, bottom in wall.pieces():
            if end - start > 0.02:  # of a wall [m]
                _put_up(builder, f'wall {number} {start:g}', wall, (start, end, bottom))
    return builder


def storey_look(builder: Builder, light: Light, changed_seed: int) -> Scene:
    """Return the storey by a ``light``, changed by a seed."""
    if changed_seed != UNCHANGED:
        builder = changed(builder, changed_seed)
    return Scene(tuple(builder.surfaces(light)))


def _put_up(
    builder: Builder, name: str, wall: WallLine, piece: tuple[float, float, float]
) -> None:
    """Put up a solid piece of a wall: start, end and bottom."""
    start, end, bottom = piece
    if not wall.along_x:  # walls along x go through where two meet
        start, end = start + 0.5 * THICKNESS, end - 0.5 * THICKNESS
    x, y = wall.place(0.5 * (start + end))
    half = 0.5 * THICKNESS
    x, y, turn = (x, y - half, 0.0) if wall.along_x else (x + half, y, 0.5 * math.pi)
    size = (end - start, THICKNESS, HEIGHT - bottom)
    builder.stand(
        Furniture(name, x, y, size, _face, _face, bottom=bottom, turn=turn),
        density=180.0,  # texels a metre
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
            front = m.FRONTS[int(rng.integers(len(m.FRONTS)))]
            is_left_out = float(rng.uniform()) > (0.25 if is_corridor else 0.75)
            depth = 0.22 if is_corridor else depth
            at, turn = _beside(cell, side, along, depth + 0.5 * THICKNESS + 0.02)
            if is_left_out or is_near_opening(*at, CLEAR):
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
