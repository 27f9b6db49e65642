"""Builder of rooms: sheets of paint, the shell, boxes that stand or hang in it, the light."""

from collections.abc import Callable, Sequence
from copy import copy
from dataclasses import dataclass, replace
from functools import partial
import math
from typing import NamedTuple

import cv2
import numpy as np

from visual_servo_epipolar.core.arrays import FloatArray, Image, IntArray
from visual_servo_epipolar.simulation.light import Box, Lamp, Light, WHITE, Window
from visual_servo_epipolar.simulation.rendering.surfaces import ROOM, Surface, Texture

GRAIN_SIZE = 1024  # the grain repeats after so many texels
GRAIN_DEVIATION = 32.0  # of the grain, grey levels around 128
FINEST = 0.8
SHIFT = 4  # sub-pixel bits of drawing
Points = Sequence[tuple[float, float]] | FloatArray


def fractal_grain(rng: np.random.Generator) -> Image:
    """
    Return periodic noise around grey 128 whose amplitude falls with frequency f as 1 / f.

    Its shape is (GRAIN_SIZE, GRAIN_SIZE). Below a wavelength of some FINEST texels it is smoothed
    away, so that it can be sampled.
    """
    frequency = np.fft.fftfreq(GRAIN_SIZE)
    radius = np.hypot(frequency[:, None], frequency[None, : GRAIN_SIZE // 2 + 1])
    radius[0, 0] = 1.0
    spectrum = np.fft.rfft2(rng.standard_normal((GRAIN_SIZE, GRAIN_SIZE), dtype=np.float32))
    spectrum *= np.exp(-2.0 * (math.pi * FINEST * radius) ** 2) / radius
    spectrum[0, 0] = 0.0
    noise = np.fft.irfft2(spectrum, (GRAIN_SIZE, GRAIN_SIZE))
    grain = np.clip(noise * (GRAIN_DEVIATION / noise.std()) + 128.0, 0.0, 255.0)
    return np.asarray(grain, dtype=np.uint8)


class Painting:
    """
    A rectangle being painted: lengths in metres from the upper left corner, grey in 0..255.

    Every method but ``lit`` paints in place by its own random generator. ``pictures`` are where
    pictures hang on it: corner and size (x, y, width, height).
    """

    def __init__(
        self, width: float, height: float, density: float, rng: np.random.Generator, grain: Image
    ) -> None:
        self.width, self.height, self.density = width, height, density
        self.rng, self.grain = rng, grain
        shape = (max(2, round(height * density)), max(2, round(width * density)))
        self.pixels: Image = np.full(shape, 128, dtype=np.uint8)
        self.pictures: list[tuple[float, float, float, float]] = []

    def copied(self, rng: np.random.Generator) -> 'Painting':
        """Return a copy, to be painted on by another random generator."""
        other = copy(self)
        other.rng, other.pixels, other.pictures = rng, self.pixels.copy(), [*self.pictures]
        return other

    def uniform(self, low: float, high: float) -> float:
        """Return a random number between ``low`` and ``high``."""
        return float(self.rng.uniform(low, high))

    def fill(self, grey: float) -> None:
        """Paint all of it."""
        self.pixels[:] = _level(grey)

    def rect(self, x: float, y: float, width: float, height: float, grey: float) -> None:
        """Paint a rectangle with its corner at (x, y)."""
        x1, y1 = x + width, y + height
        self.polygon([(x, y), (x1, y), (x1, y1), (x, y1)], grey)

    def frame(
        self, x: float, y: float, width: float, height: float, *, line: float, grey: float
    ) -> None:
        """Paint the outline of a rectangle, ``line`` wide, inside of it."""
        self.rect(x, y, width, line, grey)
        self.rect(x, y + height - line, width, line, grey)
        self.rect(x, y, line, height, grey)
        self.rect(x + width - line, y, line, height, grey)

    def disc(self, x: float, y: float, radius: float, grey: float) -> None:
        """Paint a disc around (x, y)."""
        turns = np.linspace(0.0, 2.0 * math.pi, 40, endpoint=False)
        self.polygon(np.stack([x + radius * np.cos(turns), y + radius * np.sin(turns)], 1), grey)

    def polygon(self, points: Points, grey: float) -> None:
        """Fill a polygon with corners [m], shape (N, 2)."""
        cv2.fillPoly(self.pixels, [self._texels(points)], _level(grey), cv2.LINE_AA, SHIFT)

    def _texels(self, points: Points) -> IntArray:
        texels = (np.asarray(points) * self.density - 0.5) * (1 << SHIFT)
        return np.asarray(np.rint(texels), np.int32)

    def line(self, points: Points, width: float, grey: float) -> None:
        """Draw a line through points [m], shape (N, 2), at least a texel wide."""
        style = _level(grey), max(1, round(width * self.density)), cv2.LINE_AA, SHIFT
        cv2.polylines(self.pixels, [self._texels(points)], False, *style)

    def text(self, words: str, x: float, y: float, height: float, grey: float) -> None:
        """Write words with their baseline starting at (x, y), capitals ``height`` tall."""
        at = (round(x * self.density), round(y * self.density))
        scale = height * self.density / 22.0
        style = scale, _level(grey), max(1, round(scale * 1.6)), cv2.LINE_AA
        cv2.putText(self.pixels, words, at, cv2.FONT_HERSHEY_SIMPLEX, *style)

    def paste(self, image: Image, x: float, y: float) -> None:
        """Put a picture, shape (H, W), of equal density at (x, y); what sticks out is cut off."""
        left, top = round(x * self.density), round(y * self.density)
        bottom, right = max(0, top + len(image)), max(0, left + image.shape[1])
        area = self.pixels[max(top, 0) : bottom, max(left, 0) : right]
        area[:] = image[max(-top, 0) :, max(-left, 0) :][: area.shape[0], : area.shape[1]]

    def roughen(self, amount: float, *, zoom: tuple[float, float] = (1.0, 1.0)) -> None:
        """Add grain of ``amount`` grey levels, stretched by ``zoom`` along x and y."""
        patch = self.grain_patch(self.pixels.shape, zoom)
        share = amount / GRAIN_DEVIATION
        self.pixels = np.asarray(
            cv2.addWeighted(self.pixels, 1.0, patch, share, -128.0 * share), dtype=np.uint8
        )

    def grain_patch(self, shape: tuple[int, int], zoom: tuple[float, float] = (1.0, 1.0)) -> Image:
        """Return a patch of grain of ``shape`` (H, W) from a random place, mirrored at random."""
        counts = [math.ceil(n / z) + 2 for n, z in zip(shape, zoom[::-1], strict=True)]
        starts = self.rng.integers(0, GRAIN_SIZE, 2).tolist()
        places = [
            (start - 1 - np.arange(n) if self.rng.integers(2) else start + np.arange(n))
            % GRAIN_SIZE
            for n, start in zip(counts, starts, strict=True)
        ]
        patch = self.grain[np.ix_(*places)]
        if zoom != (1.0, 1.0):
            size = (round(counts[1] * zoom[0]), round(counts[0] * zoom[1]))
            patch = np.asarray(cv2.resize(patch, size, interpolation=cv2.INTER_CUBIC), np.uint8)
        return patch[: shape[0], : shape[1]]

    def lit(self, field: FloatArray, most: int) -> Image:
        """
        Return the paint, shape (H, W), by a coarse ``field`` of light, shape (H, W), in 0..2.

        It is no brighter than ``most``, and softened so that no edge is sharper than a texel.
        """
        coarse = np.clip(field * 127.5, 0.0, 255.0).astype(np.float32)
        rows, columns = self.pixels.shape
        full = cv2.resize(coarse, (columns, rows), interpolation=cv2.INTER_LINEAR)
        pixels = cv2.min(cv2.multiply(self.pixels, full, scale=1 / 127.5, dtype=cv2.CV_8U), most)
        return np.asarray(cv2.GaussianBlur(pixels, (5, 5), 0.6), dtype=np.uint8)


def _level(grey: float) -> float:
    return float(min(255, max(0, round(grey))))


LEFT, RIGHT, REAR, HEIGHT = -5.5, 5.5, -13.0, 2.8  # the shell [m]
DENSITY = 250.0  # texels a metre on furniture
LIGHT_STEP = 0.15  # spacing of the points where the light is computed [m]
PANE_DENSITY, FRAME = 100.0, 70  # of windows: texels a metre, grey of the frame
SHADOW_STEP = 0.1  # the same, where something casts shadows [m]

Painter = Callable[[Painting], None]
Frame = tuple[FloatArray, FloatArray, FloatArray]  # a corner and both edges [m]
Material = Callable[..., None]  # paints a sheet by a ``grey``


class FloorCell(NamedTuple):
    """A room, or a stretch of corridor: its corners (x0, y0) and (x1, y1) [m]."""

    name: str
    x0: float
    y0: float
    x1: float
    y1: float


@dataclass(frozen=True)
class Furniture:
    """
    A box that stands on the floor or hangs ``bottom`` [m] above it.

    (x, y) is the middle of its front, ``size`` its width, depth and height [m]; at a ``turn``
    [rad] of 0 the front looks along -y, at the goal.
    """

    name: str
    x: float
    y: float
    size: tuple[float, float, float]
    front: Material
    sides: Material
    bottom: float = 0.0
    turn: float = 0.0

    def axes(self) -> tuple[FloatArray, FloatArray]:
        """Return unit vectors, shape (3,), to the right of its front, and along its depth."""
        sin, cos = math.sin(self.turn), math.cos(self.turn)
        return np.array([cos, sin, 0.0]), np.array([-sin, cos, 0.0])

    def distances(self, points: FloatArray) -> FloatArray:
        """Distances of ``points``, shape (..., 3), from its footprint on the floor [m]."""
        box = self.box
        away = np.maximum(np.abs((points - box.middle) @ box.axes.T) - box.half, 0.0)
        return np.asarray(np.hypot(away[..., 0], away[..., 1]))

    @property
    def box(self) -> Box:
        """The box that casts its shadow."""
        right, back = self.axes()
        half = 0.5 * np.array(self.size)
        middle = np.array([self.x, self.y, self.bottom + half[2]]) + half[1] * back
        return Box(middle, np.array([right, back, [0.0, 0.0, 1.0]]), half)


@dataclass(frozen=True, eq=False, slots=True)
class Panel:
    """A painted rectangle of a body, not lit yet; ``frame`` is its corner and its edges [m]."""

    name: str
    body: str
    frame: Frame
    sheet: Painting
    standing: Sequence[Furniture] = ()

    def with_moved(self, piece: Furniture, moved: Furniture) -> 'Panel':
        """Return the panel where a ``piece`` has ``moved``, itself or what stands before it."""
        if piece in self.standing:
            standing = [moved if each == piece else each for each in self.standing]
            return replace(self, standing=standing)
        if self.body != piece.name:
            return self
        origin, *edges = self.frame
        shift = np.array([moved.x - piece.x, moved.y - piece.y, 0.0])
        return replace(self, frame=(origin + shift, *edges))

    def lit(
        self, light: Light, ceiling_lamps: Sequence[FloatArray], boxes: Sequence[Box]
    ) -> Surface:
        """Return the surface as it looks by ``light``."""
        origin, edge_u, edge_v = self.frame
        most = WHITE - light.casts_shadows  # white is for windows, which glare
        width, height = self.sheet.width, self.sheet.height
        step = SHADOW_STEP if light.casts_shadows else LIGHT_STEP
        u, v = _grid(width, step), _grid(height, step)
        points = origin + u[None, :, None] * edge_u + v[:, None, None] * edge_v
        field = light.on(points, np.cross(edge_v / height, edge_u / width), ceiling_lamps, boxes)
        if self.body == ROOM:
            field *= _corners(u * width, width)[None] * _corners(v * height, height)[:, None]
        for piece in self.standing:
            field *= 1.0 - 0.6 * np.exp(-piece.distances(points) / 0.16)
        texture = Texture(self.sheet.lit(field, most))
        return Surface(self.name, self.body, origin, edge_u, edge_v, texture)


class Builder:
    """
    Collects the painted panels of rooms, to be seen by any light.

    ``lamps`` on the ceilings (x, y) and the ``end`` of a single room along y are in metres.
    ``sources`` light a cell alone; ``dimmed`` has the shares that ambient light and that of the
    lamps have of the usual ones.
    """

    def __init__(
        self, rng: np.random.Generator, lamps: Sequence[tuple[float, float]], end: float = 0.0
    ) -> None:
        self.rng, self.lamps, self.end = rng, lamps, end
        self.panels: list[Panel] = []
        self.standing: list[Furniture] = []
        self.sources: dict[FloorCell, tuple[Lamp | Window, ...]] = {}
        self.dimmed = 1.0, 1.0
        self._grain = fractal_grain(rng)

    def copied(self, rng: np.random.Generator) -> 'Builder':
        """Return a builder of the same rooms, which is changed by another random generator."""
        other = copy(self)
        other.rng, other.panels, other.standing = rng, [*self.panels], [*self.standing]
        other.sources = {**self.sources}
        return other

    def move(self, piece: Furniture, shift: FloatArray) -> None:
        """Move a piece of furniture by ``shift``, shape (2,) [m]."""
        x, y = shift.tolist()
        moved = replace(piece, x=piece.x + x, y=piece.y + y)
        self.standing[self.standing.index(piece)] = moved
        self.panels = [panel.with_moved(piece, moved) for panel in self.panels]

    def wall(self, side: str, paint: Painter, *, density: float = 220.0) -> None:
        """Put up the 'front', 'left', 'right' or 'rear' wall; ``density`` is in texels a metre."""
        around = [(LEFT, self.end), (RIGHT, self.end), (RIGHT, REAR), (LEFT, REAR)]
        k = ['front', 'right', 'rear', 'left'].index(side)
        edge = np.array([*np.subtract(around[k - 3], around[k]), 0.0])
        frame = (np.array([*around[k], HEIGHT]), edge, np.array([0.0, 0.0, -HEIGHT]))
        self._panel(f'{side} wall', ROOM, frame, paint, density)

    def cover(
        self,
        cell: FloorCell,
        floor: Painter,
        ceiling: Callable[..., None],
        furniture: Sequence[Furniture],
        densities: tuple[float, float] = (190.0, 150.0),
    ) -> None:
        """
        Lay the floor of a cell, with the shadows of ``furniture`` on it, and hang its ceiling.

        ``ceiling`` paints lamps where they hang on its sheet; ``densities`` are texels a metre.
        """
        right, far = np.array([cell.x1 - cell.x0, 0.0, 0.0]), np.array([0, cell.y1 - cell.y0, 0.0])
        frame = np.array([cell.x0, cell.y1, 0.0]), right, -far
        low = [piece for piece in furniture if piece.bottom < 0.3]
        self._panel(f'{cell.name} floor', ROOM, frame, floor, densities[0], low)
        lamps = [
            (x - cell.x0, y - cell.y0)
            for x, y in self.lamps
            if cell.x0 < x < cell.x1 and cell.y0 < y < cell.y1
        ]
        frame, paint = (
            (np.array([cell.x0, cell.y0, HEIGHT]), right, far),
            partial(ceiling, lamps=lamps),
        )
        self._panel(f'{cell.name} ceiling', ROOM, frame, paint, densities[1])

    def stand(self, piece: Furniture, *, density: float = DENSITY) -> None:
        """Put a piece of furniture in its place: all faces but the one it stands on."""
        self.standing.append(piece)
        right, back = piece.axes()
        width, depth, height = piece.size
        x, y, down = width * right, depth * back, np.array([0.0, 0.0, -height])
        top = np.array([piece.x, piece.y, piece.bottom + height]) - 0.5 * x
        faces = {
            'front': (top, x, down),
            'right': (top + x, y, down),
            'back': (top + x + y, -x, down),
            'left': (top + y, -y, down),
            'top': (top + y, x, -y),
        }
        if piece.bottom > 0.3:
            faces['bottom'] = (top + down, x, y)
        grey = float(self.rng.uniform(80.0, 170.0))
        for name, frame in faces.items():
            paint = partial(piece.front if name == 'front' else piece.sides, grey=grey)
            self._panel(f'{piece.name} {name}', piece.name, frame, paint, density)

    def _panel(
        self,
        name: str,
        body: str,
        frame: Frame,
        paint: Painter,
        density: float,
        standing: Sequence[Furniture] = (),
    ) -> None:
        """Add a painted rectangle, ``density`` in texels a metre."""
        width, height = (float(np.linalg.norm(edge)) for edge in frame[1:])
        sheet = Painting(width, height, density, self.rng, self._grain)
        paint(sheet)
        self.panels.append(Panel(name, body, frame, sheet, standing))

    def surfaces(self, light: Light) -> list[Surface]:
        """Return the surfaces as they look by ``light`` and the sources; panes are the last."""
        ambient, ceiling = self.dimmed
        light = replace(light, ambient=ambient * light.ambient, ceiling=ceiling * light.ceiling)
        lamps = [np.array([x, y, HEIGHT]) for x, y in self.lamps]
        boxes = [piece.box for piece in self.standing]
        found = [panel.lit(self._light_on(panel, light), lamps, boxes) for panel in self.panels]
        for cell, sources in self.sources.items():
            found += panes(sources, cell.name)
        return found

    def _light_on(self, panel: Panel, light: Light) -> Light:
        """Return the light in the cells that a panel is in."""
        origin, edge_u, edge_v = panel.frame
        ends = origin[:2], origin[:2] + edge_u[:2] + edge_v[:2]
        low, high = np.min(ends, axis=0), np.max(ends, axis=0)
        own = [
            source
            for cell, sources in self.sources.items()
            if cell.x0 < high[0] and cell.x1 > low[0] and cell.y0 < high[1] and cell.y1 > low[1]
            for source in sources
        ]
        return replace(light, sources=(*light.sources, *own))


def panes(sources: Sequence[Lamp | Window], cell: str = '') -> list[Surface]:
    """Return the windows among ``sources`` of light, right in front of their walls."""
    surfaces = []
    for number, window in enumerate(each for each in sources if isinstance(each, Window)):
        across, down = window.edges
        origin = np.array(window.middle) - 0.5 * (across + down)
        origin += 0.01 * np.array(window.normal)
        texture, name = Texture(_glass(*window.size)), f'{cell} window {number}'
        surfaces.append(Surface(name, name, origin, across, down, texture))
    return surfaces


def _glass(width: float, height: float) -> Image:
    """Return a window of white panes in a dark frame, shape (H, W)."""
    rows, columns = round(height * PANE_DENSITY), round(width * PANE_DENSITY)
    image: Image = np.full((rows, columns), WHITE, np.uint8)
    cv2.rectangle(image, (0, 0), (columns - 1, rows - 1), FRAME, 7)
    cv2.line(image, (columns // 2, 0), (columns // 2, rows), FRAME, 5)
    cv2.line(image, (0, rows // 3), (columns, rows // 3), FRAME, 4)
    return image


def _grid(length: float, step: float) -> FloatArray:
    """Shares of an edge at which the light is computed, at the middles of equal cells."""
    count = max(3, math.ceil(length / step))
    return (np.arange(count) + 0.5) / count


def _corners(at: FloatArray, length: float) -> FloatArray:
    """Factor of light ``at`` places along an edge [m]: corners of a room are darker."""
    return np.asarray(1.0 - 0.22 * np.exp(-np.minimum(at, length - at) / 0.22))
