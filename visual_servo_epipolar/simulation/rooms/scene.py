"""Scenes: a furnished room, a room dominated by a single wall, a plain one; or a storey."""

from collections.abc import Callable, Sequence
from dataclasses import replace
from functools import lru_cache, partial
import math
from typing import NamedTuple

import numpy as np

from visual_servo_epipolar.simulation.light import CEILING, Light, LIGHTS, UNCHANGED
from visual_servo_epipolar.simulation.rendering.surfaces import Scene
from visual_servo_epipolar.simulation.rooms import materials as m
from visual_servo_epipolar.simulation.rooms.building import (
    Builder,
    FloorCell,
    Furniture,
    LEFT,
    Painting,
    panes,
    REAR,
    RIGHT,
)
from visual_servo_epipolar.simulation.rooms.storey import storey_builder, storey_look

LAMPS = [(x, y) for y in (-11.0, -7.4, -3.8, -0.2, 3.4, 6.4) for x in (-2.9, 2.9)]

Look = Callable[[Builder, Light, int], Scene]
Material = Callable[[Painting, float], None]
Piece = tuple[str, float, float, tuple[float, float, float], Material, Material, float]

# Name, middle of the front (x, y), size, front, sides, bottom [m]. Nothing stands in the way of
# the robot: |x| < 2.2 is free up to y = 4. From the goal most of it is 3 to 7 m away.
PIECES: Sequence[Piece] = (
    ('left stand', -2.75, 3.4, (0.75, 0.08, 1.9), m.noticeboard, m.timber, 0.0),
    ('right stand', 2.85, 3.6, (0.8, 0.08, 2.1), m.noticeboard, m.timber, 0.0),
    ('bench', 0.75, 4.3, (1.0, 0.4, 0.34), m.crate, m.crate, 0.0),
    ('chest', -1.15, 4.4, (0.85, 0.5, 0.62), m.cupboard, m.crate, 0.0),
    ('parcel', -1.25, 4.47, (0.46, 0.36, 0.42), m.crate, m.crate, 0.62),
    ('banner', -0.9, 3.9, (1.5, 0.03, 0.55), m.noticeboard, m.noticeboard, 2.15),
    ('sign', 1.35, 4.7, (1.3, 0.03, 0.6), m.noticeboard, m.noticeboard, 2.1),
    ('tall books', -2.75, 4.8, (1.25, 0.35, 2.15), m.bookcase, m.timber, 0.0),
    ('cabinet', 2.45, 4.7, (1.2, 0.5, 1.15), m.cupboard, m.timber, 0.0),
    ('cases', 2.5, 4.78, (0.7, 0.34, 0.5), m.crate, m.crate, 1.15),
    ('column', -0.35, 5.7, (0.38, 0.38, 2.8), m.pillar, m.pillar, 0.0),
    ('board', 1.15, 5.6, (1.2, 0.06, 1.75), m.noticeboard, m.timber, 0.0),
    ('wide books', -4.25, 5.6, (1.4, 0.35, 2.2), m.bookcase, m.timber, 0.0),
    ('lockers', 4.3, 5.6, (1.2, 0.5, 2.0), m.cupboard, m.noticeboard, 0.0),
    ('low books', -1.75, 6.7, (1.3, 0.35, 1.6), m.bookcase, m.timber, 0.0),
    ('easel', 0.3, 6.8, (0.9, 0.06, 1.9), m.noticeboard, m.timber, 0.0),
    ('right column', 3.3, 6.5, (0.38, 0.38, 2.8), m.pillar, m.pillar, 0.0),
    ('dresser', 2.2, 7.1, (1.1, 0.45, 2.0), m.cupboard, m.timber, 0.0),
)
PLAIN_PIECES: Sequence[Piece] = (  # a third of the furnished room
    ('left stand', -2.45, 3.5, (0.7, 0.08, 1.6), m.noticeboard, m.smooth, 0.0),
    ('chest', -0.95, 4.5, (0.85, 0.5, 0.62), m.cupboard, m.smooth, 0.0),
    ('cabinet', 2.2, 4.7, (1.1, 0.5, 1.15), m.cupboard, m.smooth, 0.0),
    ('sign', 0.8, 5.0, (0.9, 0.03, 0.5), m.noticeboard, m.smooth, 1.9),
    ('column', -0.3, 5.9, (0.38, 0.38, 2.8), m.pillar, m.smooth, 0.0),
    ('dresser', 1.5, 7.0, (1.1, 0.45, 1.9), m.cupboard, m.smooth, 0.0),
    ('low case', -2.6, 6.6, (1.2, 0.35, 1.4), m.cupboard, m.smooth, 0.0),
)
BOXES_BEFORE_WALL: Sequence[Piece] = (
    ('left box', -0.26, 0.46, (0.24, 0.16, 0.62), m.crate, m.crate, 0.0),
    ('right box', 0.3, 0.5, (0.2, 0.15, 0.5), m.crate, m.crate, 0.0),
)
NEAR_DENSITY = 700.0  # of a wall that fills the image from 0.7 m: texels a metre
PLAIN_WALLS = {'front': 'bbpbdbb', 'left': 'bbbpbbdbbbpb', 'right': 'bbpbbbbbbdbb', 'rear': 'bdb'}


def room(seed: int, kind: str = 'room', light: str = CEILING) -> Scene:
    """
    Return a room; all arguments together fix every texel of it. The last room is kept.

    A 'room' has furniture 3-8 m ahead of the goal (0, 0), looking along +y; a 'wall' is full of
    pictures 5 m ahead, over a floor with little texture, a 'nearwall' the same 0.7 m ahead,
    'nearwall_boxes' with two boxes before it; a 'plain' room has painted walls, few pictures,
    little furniture, all of weak contrast. It is painted once for all in LIGHTS, and lit once for
    each. Raises ValueError if the kind is unknown.
    """
    return painted_room(seed, kind).by(light)


class PaintedRoom:
    """A room as its ``look`` by each light, and after each change, that was asked for."""

    def __init__(self, builder: Builder, look: Look, kept: int) -> None:
        self._builder, self._look, self._kept = builder, look, kept
        self._scenes: dict[tuple[str, int], Scene] = {}

    def by(self, light: str, changed_seed: int = UNCHANGED) -> Scene:
        """Return the room by the light of that name, changed by a seed; the last are kept."""
        key = light, changed_seed
        scene = self._scenes.pop(key, None)
        if scene is None and len(self._scenes) == self._kept:
            del self._scenes[next(iter(self._scenes))]
        self._scenes[key] = scene or self._look(self._builder, LIGHTS[light], changed_seed)
        return self._scenes[key]


@lru_cache(maxsize=1)  # a room and its filtered pictures take some 300 MB, a storey as much
def painted_room(seed: int, kind: str = 'room') -> PaintedRoom:
    """Build a room, in one to two seconds; raises ValueError as ``room`` does."""
    if kind == 'storey':  # of a building, in the coordinates of its plan
        return PaintedRoom(storey_builder(seed), storey_look, 1)  # small machines hold no two
    if kind not in KINDS:
        raise ValueError(f'kind of room must be one of {", ".join(KINDS)}, got {kind!r}')
    end, build = KINDS[kind]
    rng = np.random.default_rng((seed, [*KINDS].index(kind)))
    builder = Builder(rng, [(x, y) for x, y in LAMPS if y < end], end)
    build(builder)

    def look(builder: Builder, light: Light, changed_seed: int) -> Scene:
        light = light.in_room(end)  # it never changes
        return Scene((*builder.surfaces(light), *panes(light.sources)))

    return PaintedRoom(builder, look, 3)  # a photograph's, a run's, another's


def _cell(builder: Builder) -> FloorCell:
    return FloorCell('', LEFT, REAR, RIGHT, builder.end)


def _furnish(builder: Builder) -> None:
    """Build a room full of furniture."""
    pieces = [*_ahead(PIECES, builder.rng), *_along_the_sides(builder.rng)]
    builder.wall('front', _wall('pwpdpwp', builder.rng))
    builder.wall('left', _wall('pwpdpwppwpwp', builder.rng))
    builder.wall('right', _wall('wppwpdpwpwpp', builder.rng))
    builder.wall('rear', lambda sheet: m.wall(sheet, fittings='pdp'), density=128.0)
    builder.cover(_cell(builder), _floor, m.ceiling, pieces)
    for piece in pieces:
        builder.stand(piece)


def _build_walls(builder: Builder, density: float = 240.0, pieces: Sequence[Piece] = ()) -> None:
    """Build a room, empty but for ``pieces``, whose front wall is a gallery."""
    builder.wall('front', lambda sheet: m.wall(sheet, pictures=2.6), density=density)
    for side in ('left', 'right', 'rear'):
        builder.wall(side, m.wall, density=128.0)
    furniture = _ahead(pieces, builder.rng)
    builder.cover(_cell(builder), m.concrete, partial(m.ceiling, plain=True), furniture)
    for piece in furniture:
        builder.stand(piece, density=density)


def _furnish_plainly(builder: Builder) -> None:
    """Build painted walls with few pictures, smooth furniture, weak contrast everywhere."""
    for side, fittings in PLAIN_WALLS.items():
        paint = m.faded(_wall(fittings, builder.rng))
        builder.wall(side, paint, density=128.0 if side == 'rear' else 220.0)
    pieces = _ahead(PLAIN_PIECES, builder.rng)
    builder.cover(_cell(builder), m.concrete, _plain_ceiling, pieces)
    for piece in pieces:
        builder.stand(replace(piece, front=m.faded(piece.front), sides=m.faded(piece.sides)))


def _plain_ceiling(sheet: Painting, lamps: list[tuple[float, float]]) -> None:
    sheet.fill(205.0)
    sheet.roughen(2.0, zoom=(7.0, 7.0))


def _wall(fittings: str, rng: np.random.Generator) -> Callable[[Painting], None]:
    """Return the painter of a wall whose fittings come in a random order."""
    order = ''.join(rng.permutation(list(fittings)))
    return lambda sheet: m.wall(sheet, fittings=order)


def _floor(sheet: Painting) -> None:
    """Lay planks, and rugs down the middle of the room; the front wall is at the upper edge."""
    m.planks(sheet)
    for y in (4.0, 9.5, 15.0):
        width, height = sheet.rng.uniform((2.2, 1.6), (3.4, 2.3))
        x = 0.5 * (sheet.width - width) + float(sheet.rng.uniform(-0.8, 0.8))
        m.rug(sheet, x, y + float(sheet.rng.uniform(-0.5, 0.5)), float(width), float(height))
    m.wear(sheet, 0.8)


def _ahead(table: Sequence[Piece], rng: np.random.Generator) -> list[Furniture]:
    """Place the furniture ahead of the goal, moved a little by the random generator."""
    pieces: list[Furniture] = []
    for name, x, y, size, front, sides, bottom in table:
        slack = rng.uniform(-1.0, 1.0, 3)
        moved, turn = np.array([x, y]) + slack[:2] * (0.12, 0.08), 0.05 * float(slack[2])
        below = next((piece for piece in pieces if piece.size[2] == bottom > 0.0), None)
        if below is not None:  # stands on another piece, and moves with it
            base = next(item for item in table if item[0] == below.name)
            right, back = below.axes()
            offset = (x - base[1]) * right + (y - base[2]) * back
            moved, turn = np.array([below.x, below.y]) + offset[:2], below.turn
        at = float(moved[0]), float(moved[1])
        pieces.append(Furniture(name, *at, size, front, sides, bottom=bottom, turn=turn))
    return pieces


def _along_the_sides(rng: np.random.Generator) -> list[Furniture]:
    """Place furniture against both side walls, all the way to the rear."""
    pieces = []
    for side, x in ((1.0, LEFT), (-1.0, RIGHT)):
        for k, y in enumerate((-11.3, -9.0, -6.8, -4.5, -2.2, 0.0, 2.3)):
            width, depth, height = rng.uniform((0.8, 0.35, 0.6), (1.5, 0.5, 2.1))
            front = m.FRONTS[int(rng.integers(len(m.FRONTS)))]
            at = x + side * (depth + 0.02), y + float(rng.uniform(-0.25, 0.25))
            size = (float(width), float(depth), float(height))
            name = f'{"left" if side > 0 else "right"} piece {k}'
            pieces.append(Furniture(name, *at, size, front, m.timber, turn=side * math.pi / 2.0))
    return pieces


class RoomKind(NamedTuple):
    """How far the front wall is from the goal [m], and the function that builds the room."""

    end: float
    build: Callable[[Builder], None]


KINDS = {
    'room': RoomKind(8.0, _furnish),
    'wall': RoomKind(5.0, _build_walls),
    'plain': RoomKind(8.0, _furnish_plainly),
    'nearwall': RoomKind(0.7, partial(_build_walls, density=NEAR_DENSITY)),
    'nearwall_boxes': RoomKind(
        0.7, partial(_build_walls, density=NEAR_DENSITY, pieces=BOXES_BEFORE_WALL)
    ),
}
