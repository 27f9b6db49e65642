"""Storey: a ring of corridors around two rooms, with two more beside it; the world of routes."""

from dataclasses import dataclass
from functools import cached_property
import math

import numpy as np

from visual_servo_epipolar.core.arrays import FloatArray
from visual_servo_epipolar.simulation.light.lights import LIGHTS, RoomChange, UNCHANGED
from visual_servo_epipolar.simulation.rendering.surfaces import ROOM, Scene
from visual_servo_epipolar.simulation.rooms import materials as m
from visual_servo_epipolar.simulation.rooms.building import Builder, Furniture, HEIGHT
from visual_servo_epipolar.simulation.rooms.changes import changed_storey
from visual_servo_epipolar.simulation.rooms.floor_plan import FloorCell, PLAN, THICKNESS, WallLine
from visual_servo_epipolar.simulation.rooms.textures import Painting

CORRIDORS = ('south', 'north', 'west', 'east')
LAMP_SPACING = 3.6  # at most [m]
WALL_DENSITY = 180.0  # texels a metre
LEAST_PIECE = 0.02  # of a wall [m]
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
                if end - start > LEAST_PIECE:
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
            density=WALL_DENSITY,
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
