"""Changes: what is another thing in a storey in the run than in the photograph."""

from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np

from visual_servo_epipolar.simulation.light.lights import (
    FURNITURE,
    Lamp,
    LAMPS,
    Light,
    PICTURES,
    RoomChange,
    STOREY,
    Window,
)
from visual_servo_epipolar.simulation.rendering.surfaces import ROOM, Surface
from visual_servo_epipolar.simulation.rooms import materials as m
from visual_servo_epipolar.simulation.rooms.building import Builder, Furniture, Panel
from visual_servo_epipolar.simulation.rooms.floor_plan import FloorCell, PLAN
from visual_servo_epipolar.simulation.rooms.materials import poster

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
CLEAR = 0.7  # of a chair beside an opening [m]
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
        if not PLAN.is_near_opening(x, y, CLEAR):
            return Furniture(name, x, y, CHAIR, m.crate, m.timber, turn=turn)


APPLIED = {LAMPS: _switch_lamps, PICTURES: _exchange_pictures, FURNITURE: _move_furniture}
