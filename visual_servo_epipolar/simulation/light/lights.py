"""Named lights: what lights the room at noon, at dusk, by a lamp; a light is a row."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from types import MappingProxyType

import numpy as np

from visual_servo_epipolar.core.arrays import FloatArray
from visual_servo_epipolar.simulation.light.sources import Box, Lamp, Window

OVERHEAD = 1.4  # of the light from everywhere on what faces down: the floor throws it back
Source = Lamp | Window


@dataclass(frozen=True, slots=True)
class Light:
    """
    A light of the room; by light 1 paint looks as grey as it is painted.

    ``level`` is what a camera of fixed exposure sees of it: textures are lit without, so that
    their eight bits hold a room that is all but black. ``ceiling`` is the power of each lamp
    on the ceiling, all of which face down and cast no shadows. ``colour`` is red, green and blue
    of what is grey; the grey of a camera without colours does not depend on it.
    """

    name: str
    what: str
    level: float
    ambient: float
    ceiling: float = 0.0
    sources: tuple[Source, ...] = ()
    colour: tuple[float, float, float] = (1.0, 1.0, 1.0)

    @property
    def windows(self) -> list[Window]:
        """The windows among its sources."""
        return [source for source in self.sources if isinstance(source, Window)]

    def in_room(self, end: float) -> 'Light':
        """Return the light in a room whose front wall, with its windows, is at y = ``end`` [m]."""
        sources = tuple(
            replace(it, middle=(it.middle[0], end, it.middle[2]))
            if isinstance(it, Window) and it.normal[1] < 0.0
            else it
            for it in self.sources
        )
        return replace(self, sources=sources)

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
        light = np.full(shape, OVERHEAD * self.ambient if faces_down else self.ambient)
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
LAMP_RIGHT, LAMP_SIDE = Lamp((3.8, -0.8, 2.2), 17.0), Lamp((-5.2, 3.0, 2.3), 16.6)
LAMP_BEHIND = Lamp((0.0, -9.0, 2.4), 30.0)
OPENED = Window((-0.6, 8.0, 2.0), (3.6, 1.4), sky=20.0, normal=(0.0, -1.0, 0.0))
DUSK_WINDOW = Window((-5.5, 0.2, 1.75), (3.4, 1.6), sky=27.9)
BLUE, WARM = (0.85, 1.0, 1.35), (1.35, 0.95, 0.45)
ROWS = (
    Light(CEILING, 'the lamps on the ceiling', 1.0, 0.75, ceiling=1.9),
    Light('noon', 'daylight, and the sun through a window', 1.0, 0.55, sources=(NOON_WINDOW,)),
    Light('dusk', 'a window on the left', 1.0, 0.093, sources=(DUSK_WINDOW,), colour=BLUE),
    Light('lamp_right', 'one lamp on the right', 1.0, 0.07, sources=(LAMP_RIGHT,), colour=WARM),
    Light('lamp_side', 'one lamp from the side', 1.0, 0.055, sources=(LAMP_SIDE,), colour=WARM),
    Light('dark', 'one lamp far behind', 0.25, 0.15, sources=(LAMP_BEHIND,), colour=WARM),
    Light('window', 'lamps, and a bright window ahead', 1.0, 0.75, ceiling=1.9, sources=(OPENED,)),
)
LIGHTS: Mapping[str, Light] = MappingProxyType({light.name: light for light in ROWS})
