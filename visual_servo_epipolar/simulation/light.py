"""Light: lamps, windows with sky and sun, shadows of boxes between; exposure that follows it."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
import math
from typing import Any, ClassVar

import cv2
import numpy as np

from visual_servo_epipolar.core.arrays import BoolArray, FloatArray, Image
from visual_servo_epipolar.core.settings import fixed, internal, setting, Settings

SOFT = 0.05  # of a lamp's size [m^2]: no point is infinitely bright
PANES = 2  # points along each side of a window that its sky is summed up from
Point = tuple[float, float, float]


@dataclass(frozen=True, eq=False, slots=True)
class Box:
    """A box that casts shadows: its middle, unit axes as rows, and half its size along them."""

    middle: FloatArray
    axes: FloatArray
    half: FloatArray

    def hides(self, points: FloatArray, towards: FloatArray) -> BoolArray:
        """Return which of ``points``, (N, 3), have the box between them and p + ``towards``."""
        start, way = (points - self.middle) @ self.axes.T, towards @ self.axes.T
        way = np.where(np.abs(way) < 1e-9, 1e-9, way)
        half = np.maximum(self.half - 0.02, 1e-3)  # smaller than it looks
        one, two = (-half - start) / way, (half - start) / way
        first, last = np.minimum(one, two).max(axis=1), np.maximum(one, two).min(axis=1)
        return np.asarray((first < last) & (last > 0.0) & (first < 1.0))


def _shadowed(
    light: FloatArray, points: FloatArray, towards: FloatArray, boxes: Sequence[Box]
) -> FloatArray:
    """Return ``light`` on ``points``, shape (N,), without what falls into a shadow."""
    bright = np.flatnonzero(light)
    if not len(bright):
        return light
    points, towards = points[bright], towards[bright]
    ends = np.concatenate([points, points + towards])
    low, high = ends.min(axis=0), ends.max(axis=0)
    hidden = np.zeros(len(points), bool)
    for box in boxes:
        reach = float(np.linalg.norm(box.half))
        if (box.middle + reach > low).all() and (box.middle - reach < high).all():
            hidden |= box.hides(points, towards)
    light[bright[hidden]] = 0.0
    return light


@dataclass(frozen=True, slots=True)
class Lamp:
    """A bulb at ``place`` [m]; ``power`` is what it throws on a surface that faces it 1 m away."""

    place: Point
    power: float

    def on(self, points: FloatArray, normal: FloatArray, boxes: Sequence[Box]) -> FloatArray:
        """Return the light on ``points``, shape (N, 3), of a surface with that unit ``normal``."""
        towards = np.array(self.place) - points
        square = (towards**2).sum(axis=1) + SOFT
        cosines = np.maximum(towards @ normal, 0.0) / np.sqrt(square)
        return _shadowed(self.power * cosines / square, points, towards, boxes)


@dataclass(frozen=True, slots=True)
class Window:
    """
    A window: its middle, its size along the wall and up [m], the unit normal into the room.

    ``sky`` is the light on a surface that saw nothing else; ``sun`` that on a surface across its
    rays, which come from the direction ``sun_from``, where the window lets them through.
    """

    middle: Point
    size: tuple[float, float]
    sky: float
    sun: float = 0.0
    sun_from: Point = (-1.0, -0.5, 0.9)
    normal: Point = (1.0, 0.0, 0.0)

    @property
    def edges(self) -> FloatArray:
        """Its edges to the right, as seen from inside, and down [m], shape (2, 3)."""
        x, y, _ = self.normal
        return np.asarray(
            [[-y * self.size[0], x * self.size[0], 0.0], [0.0, 0.0, -self.size[1]]], np.float64
        )

    def on(self, points: FloatArray, normal: FloatArray, boxes: Sequence[Box]) -> FloatArray:
        """Return the light on ``points``, shape (N, 3), of a surface with that unit ``normal``."""
        return self._sky(points, normal, boxes) + self._sun(points, normal, boxes)

    def _sky(self, points: FloatArray, normal: FloatArray, boxes: Sequence[Box]) -> FloatArray:
        share = self.sky * self.size[0] * self.size[1] / PANES**2 / math.pi
        light = np.zeros(len(points))
        for pane in np.ndindex(PANES, PANES):
            place = (np.array(pane) + 0.5) / PANES - 0.5
            towards = np.array(self.middle) + place @ self.edges - points
            square = (towards**2).sum(axis=1) + SOFT
            # Lambert's cosines, on the surface and at the pane
            leaving = np.maximum(-towards @ np.array(self.normal), 0.0)
            cosines = np.maximum(towards @ normal, 0.0) * leaving / square
            light += _shadowed(share * cosines / square, points, towards, boxes)
        return light

    def _sun(self, points: FloatArray, normal: FloatArray, boxes: Sequence[Box]) -> FloatArray:
        rays = np.array(self.sun_from) / np.linalg.norm(self.sun_from)
        cosine = float(normal @ rays)
        if self.sun == 0.0 or cosine <= 0.0:
            return np.zeros(len(points))
        offset, out = np.array(self.middle) - points, np.array(self.normal)
        towards = (offset @ out)[:, None] / (rays @ out) * rays
        along, up = np.abs(((towards - offset) @ self.edges.T) / np.square(self.size)).T
        through = (along < 0.5) & (up < 0.5)
        return _shadowed(np.where(through, self.sun * cosine, 0.0), points, towards, boxes)


@dataclass(frozen=True, slots=True)
class Light:
    """
    A light of the room; by light 1 paint looks as grey as it is painted.

    ``level`` is what a camera of fixed exposure sees of it: textures are lit without, so that
    their eight bits hold a room that is all but black. ``ceiling`` is the power of each lamp
    on the ceiling, all of which face down and cast no shadows.
    """

    name: str
    level: float
    ambient: float
    ceiling: float = 0.0
    sources: tuple[Lamp | Window, ...] = ()

    def in_room(self, end: float) -> 'Light':
        """Return the light in a room whose front wall, with its windows, is at y = ``end`` [m]."""
        moved = replace(OPENED, middle=(OPENED.middle[0], end, OPENED.middle[2]))
        return replace(self, sources=tuple(moved if it is OPENED else it for it in self.sources))

    @property
    def casts_shadows(self) -> bool:
        """Whether something in the room makes shadows, whose edges ask for a finer grid."""
        return bool(self.sources)

    def on(
        self,
        points: FloatArray,
        normal: FloatArray,
        ceiling_lamps: Sequence[FloatArray],
        boxes: Sequence[Box],
    ) -> FloatArray:
        """
        Return the light, shape (H, W), on ``points``, shape (H, W, 3), by Lambert's law.

        ``ceiling_lamps`` are where the lamps hang, shape (3,) each; ``boxes`` cast shadows.
        """
        shape, faces_down = points.shape[:2], normal[2] < -0.5
        # The floor throws light back at what faces down.
        light = np.full(shape, 1.4 * self.ambient if faces_down else self.ambient)
        for lamp in ceiling_lamps if self.ceiling and not faces_down else ():
            towards = lamp - points
            square = (towards**2).sum(axis=-1) + 0.15
            cosines = np.maximum(towards @ normal, 0.0) * np.maximum(towards[..., 2], 0.0)
            light += self.ceiling * cosines / square**2
        for source in self.sources:
            light += source.on(points.reshape(-1, 3), normal, boxes).reshape(shape)
        return light


CEILING = 'ceiling'  # the usual one: the lamps of the room
NOON_WINDOW = Window((-5.5, 0.2, 1.75), (3.4, 1.6), sky=30.0, sun=1.2, sun_from=(-1.0, -0.7, 0.5))
OPENED = Window((-0.6, 8.0, 2.0), (3.6, 1.4), sky=20.0, normal=(0.0, -1.0, 0.0))
DUSK_WINDOW = Window((-5.5, 0.2, 1.75), (3.4, 1.6), sky=27.9)
LIGHTS: Mapping[str, Light] = {
    light.name: light
    for light in (
        Light(CEILING, 1.0, 0.75, ceiling=1.9),
        Light('noon', 1.0, 0.55, sources=(NOON_WINDOW,)),  # daylight, and the sun
        Light('dusk', 1.0, 0.093, sources=(DUSK_WINDOW,)),
        Light('lamp_right', 1.0, 0.07, sources=(Lamp((3.8, -0.8, 2.2), 17.0),)),
        Light('lamp_side', 1.0, 0.055, sources=(Lamp((-5.2, 3.0, 2.3), 16.6),)),
        Light('dark', 0.25, 0.15, sources=(Lamp((0.0, -9.0, 2.4), 30.0),)),
        Light('window', 1.0, 0.75, ceiling=1.9, sources=(OPENED,)),  # bright, ahead
    )
}
DAY = ('noon', 'ceiling', 'dusk', 'lamp_right', 'lamp_side')
EACH = 'each'  # one of DAY, by the seed
UNCHANGED = -1  # in place of the seed of what changed


@dataclass(frozen=True, kw_only=True)
class LightSettings(Settings):
    """Light of the photograph and of the run, what changed, and how a camera follows."""

    light: str = setting(
        CEILING, 'Light of the run; each: one of five, by the seed', choices=(*LIGHTS, EACH)
    )
    photograph_light: str = fixed(CEILING, 'Light of the photograph', choices=tuple(LIGHTS))
    changed_by: int = internal(
        UNCHANGED,
        'Seed of what is another in the run in a storey: lamps, windows, pictures, furniture; '
        '-1 = nothing',
        low=UNCHANGED,
        high=2**31 - 1,
    )
    gamma: float = internal(
        1.0, 'Gamma of the run: grey is to the power of it, white stays white', low=0.4, high=2.5
    )
    exposure: str = setting(
        'fixed', 'Exposure: fixed, or auto as it follows the light', choices=('fixed', 'auto')
    )
    GONE: ClassVar[Mapping[str, Any]] = {
        'changed': 'none',
        'changed_seed': 0,
        'passing_exposure': 1.0,
        'passing_light': 'same',
        'target_grey': 100.0,
        'max_gain': 4.0,
        'exposure_step': 0.25,
        'white_balance': 'fixed',
        'flicker': 0.0,
        'flicker_rate': 100.0,
    }

    def light_of(self, seed: int) -> Light:
        """Return the light of a run with that seed."""
        return LIGHTS[DAY[seed % len(DAY)] if self.light == EACH else self.light]


STOP = 12  # steps in which the exposure is set, a factor of two [1]
HYSTERESIS = 2  # steps off the target at which the exposure begins to follow
SPACING = 4  # of the pixels that are metered [px]
WHITE = 255  # of a window: what is drawn so is GLARE times as bright, however short the exposure
GLARE = 16.0


class Exposure:
    """
    The exposure of a camera, from image to image; 1 is the fixed one.

    An automatic one is set by the image before, by a quarter of a stop at most, and has settled on
    the first image. Up to 1 it is a shorter shutter, and beyond it is gain, which the noise grows
    with.
    """

    def __init__(self, settings: LightSettings) -> None:
        self.settings = settings
        self._steps: int | None = None  # in STOPs, None as long as there was no image

    def begin(self) -> None:
        """Let the exposure settle anew on the next image."""
        self._steps = None

    def take(self, image: Image, by: Light, gamma: float = 1.0) -> tuple[Image, float]:
        """Return the image, shape (H, W), as it is exposed, and the gain, which noise grows by."""
        if self._steps is None:
            self._steps, last = 0, None
            while self._steps != last:
                last, self._steps = self._steps, self._after(self._steps, image, by)
        exposure = 2.0 ** (self._steps / STOP) if self.settings.exposure == 'auto' else 1.0
        taken = brightened(image, by.level * exposure, glare=by.casts_shadows, gamma=gamma)
        self._steps = self._after(self._steps, image, by)
        return taken, max(exposure, 1.0)

    def _after(self, steps: int, image: Image, by: Light) -> int:
        """Return the exposure that follows one of ``steps``, by what that one takes."""
        if self.settings.exposure != 'auto':
            return steps
        metered = np.ascontiguousarray(image[::SPACING, ::SPACING])
        brightness = by.level * 2.0 ** (steps / STOP)
        taken = brightened(metered, brightness, glare=by.casts_shadows)
        off = STOP * math.log2(100.0 / max(float(cv2.mean(taken)[0]), 1.0))  # mean grey
        if abs(off) < HYSTERESIS:
            return steps
        step = min(max(round(off), -STOP // 4), STOP // 4)
        return min(max(steps + step, -6 * STOP), 2 * STOP)  # of 1/64 to four times the fixed one


def brightened(image: Image, factor: float, *, glare: bool = False, gamma: float = 1.0) -> Image:
    """
    Return ``image``, shape (H, W), ``factor`` times as bright, what glares by far more.

    Then grey is to the power of ``gamma``, in units of white.
    """
    levels = np.arange(256, dtype=np.float32) * np.float32(factor)
    levels[WHITE] *= GLARE if glare else 1.0
    levels = WHITE * (np.rint(np.minimum(levels, WHITE)).astype(float) / WHITE) ** gamma
    return np.asarray(cv2.LUT(image, np.rint(levels).astype(np.uint8)))
