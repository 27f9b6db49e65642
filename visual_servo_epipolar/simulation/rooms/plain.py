"""A plain room: painted walls with few pictures, smooth furniture, weak contrast everywhere."""

from collections.abc import Callable

import cv2
import numpy as np

from visual_servo_epipolar.simulation.rooms import furniture as c
from visual_servo_epipolar.simulation.rooms import materials as m
from visual_servo_epipolar.simulation.rooms.building import Builder, Furniture
from visual_servo_epipolar.simulation.rooms.textures import Painting

CONTRAST, MEAN = 0.25, 150.0  # share of the usual contrast that is left, around this grey

# Name, middle of the front (x, y), size, front, sides, bottom [m]: a third of the furnished room.
PIECES = (
    ('left stand', -2.45, 3.5, (0.7, 0.08, 1.6), c.noticeboard, 0.0),
    ('chest', -0.95, 4.5, (0.85, 0.5, 0.62), c.cupboard, 0.0),
    ('cabinet', 2.2, 4.7, (1.1, 0.5, 1.15), c.cupboard, 0.0),
    ('sign', 0.8, 5.0, (0.9, 0.03, 0.5), c.noticeboard, 1.9),
    ('column', -0.3, 5.9, (0.38, 0.38, 2.8), c.pillar, 0.0),
    ('dresser', 1.5, 7.0, (1.1, 0.45, 1.9), c.cupboard, 0.0),
    ('low case', -2.6, 6.6, (1.2, 0.35, 1.4), c.cupboard, 0.0),
)
WALLS = {'front': 'bbpbdbb', 'left': 'bbbpbbdbbbpb', 'right': 'bbpbbbbbbdbb', 'rear': 'bdb'}


def furnish(builder: Builder) -> None:
    """Build the room: its shell, and the few pieces in it, moved a little by chance."""
    for side, fittings in WALLS.items():
        order = ''.join(builder.rng.permutation(list(fittings)))
        builder.wall(side, fade(_wall(order)), density=128.0 if side == 'rear' else 220.0)
    pieces = [_furniture_at(piece, builder.rng) for piece in PIECES]
    builder.floor(m.concrete, pieces)
    builder.ceiling(_ceiling)
    for piece in pieces:
        builder.stand(piece)


def fade(paint: Callable[..., None]) -> Callable[..., None]:
    """Return the painter that leaves CONTRAST of what ``paint`` paints."""

    def painter(sheet: Painting, *grey: float) -> None:
        paint(sheet, *grey)
        offset = (1.0 - CONTRAST) * MEAN
        sheet.pixels = np.asarray(cv2.convertScaleAbs(sheet.pixels, alpha=CONTRAST, beta=offset))

    return painter


def _wall(fittings: str) -> Callable[[Painting], None]:
    return lambda sheet: m.wall(sheet, fittings=fittings)


def _ceiling(sheet: Painting) -> None:
    sheet.fill(205.0)
    sheet.roughen(2.0, zoom=(7.0, 7.0))


def _smooth(sheet: Painting, grey: float) -> None:
    """Paint a side without a mark."""
    sheet.fill(grey)
    sheet.roughen(2.0)


def _furniture_at(
    piece: tuple[str, float, float, tuple[float, float, float], Callable[..., None], float],
    rng: np.random.Generator,
) -> Furniture:
    name, x, y, size, front, bottom = piece
    slack = rng.uniform(-1.0, 1.0, 3)
    at = x + 0.12 * float(slack[0]), y + 0.08 * float(slack[1])
    turn = 0.05 * float(slack[2])
    return Furniture(name, *at, size, fade(front), fade(_smooth), bottom=bottom, turn=turn)
