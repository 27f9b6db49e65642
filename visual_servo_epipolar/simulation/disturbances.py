"""
Image disturbances: light and occluders between the scene and the sensor.

Everything depends on settings, seed and frame index alone. Each disturbance is off at zero; the
passing ones begin with frame ``disturbed_from``, last for ``disturbed_for`` frames, and come back
after ``disturbed_every``.
"""

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import cached_property, lru_cache
import math
from typing import Any, ClassVar

import cv2
import numpy as np

from visual_servo_epipolar.core.arrays import as_gray, BoolArray, FloatArray, frozen, Image
from visual_servo_epipolar.core.settings import internal, Settings
from visual_servo_epipolar.simulation.light import brightened
from visual_servo_epipolar.simulation.rooms.building import fractal_grain

PHASES = 8  # silhouettes in one step
STEPS = 5.0  # steps on the way through the image
SLIDE = 0.25  # share of its time an obstacle takes to slide in, and out again
SOFT = 0.8  # edges are as soft as the rest of the image: sigma of the mask [px]


@dataclass(eq=False)
class Occluder:
    """
    An object before the scene, in images of one size; ``progress`` runs from 0 to 1.

    ``place`` gives its upper left corner then, and ``mask`` its outline, 255 inside. What it
    looks like is painted when it is first drawn: asking what it hides costs little.
    """

    place: Callable[[float], tuple[int, int]]
    mask: Callable[[float], Image]
    paint: Callable[[], Image]

    @cached_property
    def _picture(self) -> Image:
        return self.paint()

    def draw(self, image: Image, progress: float) -> None:
        """Draw it into ``image``, shape (H, W)."""
        place = self.place(progress)
        under, over = _areas(image, self.mask(progress), place)
        if not under.size:
            return
        picture = _areas(image, self._picture, place)[1]
        behind = cv2.multiply(under, 255 - over, scale=1.0 / 255.0)
        under[:] = cv2.add(behind, cv2.multiply(picture, over, scale=1.0 / 255.0))

    def cover(self, size: tuple[int, int], progress: float) -> BoolArray:
        """Return where it hides the scene in an image of that width and height, shape (H, W)."""
        covered: Image = np.zeros(size[::-1], np.uint8)
        under, over = _areas(covered, self.mask(progress), self.place(progress))
        under[:] = over
        return np.asarray(covered > 0)


def board(size: tuple[int, int], share: float, rng: np.random.Generator) -> Occluder:
    """Return a textured board over a ``share`` of the image, which slides in and out."""
    width, height = size
    # Three quarters of the height, unless that makes it wider than the image.
    tall = max(0.75, share)
    wide, high = round(width * share / tall), round(height * tall)
    left = round((width - wide) * rng.uniform(0.2, 0.8))
    top = round((height - high) * rng.uniform())
    mask: Image = np.full((high, wide), 255, np.uint8)

    def place(progress: float) -> tuple[int, int]:
        out = 1.0 - min(progress, 1.0 - progress, SLIDE) / SLIDE
        return round(left + out * (width - left)), top

    def paint() -> Image:
        picture = _grain((wide, high), rng, grey=110.0, contrast=1.2)
        cv2.rectangle(picture, (6, 6), (wide - 7, high - 7), 30, 4)
        return picture

    return Occluder(place, lambda progress: mask, paint)


def person(size: tuple[int, int], height: float, rng: np.random.Generator) -> Occluder:
    """Return a person who walks through the image from left to right, ``height`` of it tall."""
    tall = round(size[1] * height)
    wide, high = max(8, round(0.39 * tall)), max(16, tall)  # as a person walks
    top = size[1] - tall if height < 1.0 else 0

    def place(progress: float) -> tuple[int, int]:
        bob = 0.01 * high * abs(math.sin(2.0 * math.pi * STEPS * progress))
        return round(progress * (size[0] + wide) - wide), top - round(bob)

    def mask(progress: float) -> Image:
        return _silhouette((wide, high), int(progress * STEPS * PHASES) % PHASES / PHASES)

    return Occluder(place, mask, lambda: _clothes((wide, high), rng))


def _areas(image: Image, patch: Image, place: tuple[int, int]) -> tuple[Image, Image]:
    """Return the parts, as views, where ``patch`` with its corner at (u, v) lies on ``image``."""
    u, v = place
    rows = slice(max(v, 0), max(v + patch.shape[0], 0))
    columns = slice(max(u, 0), max(u + patch.shape[1], 0))
    under = image[rows, columns]
    return under, patch[max(-v, 0) :, max(-u, 0) :][: under.shape[0], : under.shape[1]]


def _grain(
    size: tuple[int, int], rng: np.random.Generator, *, grey: float, contrast: float
) -> Image:
    """Return mottled cloth of ``size`` (width, height)."""
    grain = fractal_grain(rng)
    tiles = -(-size[1] // grain.shape[0]), -(-size[0] // grain.shape[1])
    cloth = np.tile(grain, tiles)[: size[1], : size[0]]
    offset = grey - 128.0 * contrast
    return np.asarray(cv2.addWeighted(cloth, contrast, cloth, 0.0, offset), dtype=np.uint8)


def _clothes(size: tuple[int, int], rng: np.random.Generator) -> Image:
    """Return a checked shirt over trousers, and a face: ``size`` (width, height)."""
    width, height = size
    cloth = _grain(size, rng, grey=75.0, contrast=0.6)
    shirt = slice(round(0.15 * height), round(0.52 * height))
    check = max(4, height // 40)
    u, v = np.meshgrid(np.arange(width), np.arange(height)[shirt])
    pattern = 35 * ((u // check) % 2) + 35 * ((v // check) % 2)
    cloth[shirt] = cv2.add(cloth[shirt], pattern.astype(np.uint8))
    cloth[: shirt.start] = cv2.add(cloth[: shirt.start], 80)
    return cloth


@lru_cache(maxsize=4 * PHASES)
def _silhouette(size: tuple[int, int], phase: float) -> Image:
    """Return the mask of a walking person, 255 inside; ``phase`` 0 to 1 is one step."""
    width, height = size
    mask: Image = np.zeros((height, width), np.uint8)
    swing = math.sin(2.0 * math.pi * phase)

    def at(u: float, v: float) -> tuple[int, int]:
        return round((0.5 + u) * width), round(v * height)

    thick = max(2, round(0.11 * height))
    head, body = (0.06 * height, 0.08 * height), (0.28 * width, 0.2 * height)
    for middle, (wide, high) in ((at(0.0, 0.08), head), (at(0.0, 0.34), body)):
        cv2.ellipse(mask, middle, (round(wide), round(high)), 0, 0, 360, 255, -1)
    for side in (-1.0, 1.0):
        cv2.line(mask, at(0.08 * side, 0.5), at(0.3 * side * swing, 0.95), 255, thick)
        cv2.line(mask, at(0.22 * side, 0.22), at(-0.36 * side * swing, 0.53), 255, thick // 2)
    return frozen(np.asarray(cv2.GaussianBlur(mask, (0, 0), SOFT), dtype=np.uint8))


@dataclass(frozen=True, kw_only=True)
class DisturbanceSettings(Settings):
    """Which disturbances there are, and when; none by default."""

    disturbed_from: int = internal(60, 'First disturbed frame', low=0, high=10**6)
    disturbed_for: int = internal(33, 'Disturbed frames in a row', low=1, high=10**6)
    disturbed_every: int = internal(
        0, 'Frames from one disturbance to the next; 0 = there is but one', low=0, high=10**6
    )
    light_step: float = internal(
        0.0, 'Change of the light from the first frame on', low=-0.95, high=2.0
    )
    light_wave: float = internal(
        0.0, 'Amplitude of a change of light in 120 frames', low=0.0, high=0.9
    )
    occlusion: float = internal(
        0.0, 'Share of the image behind an obstacle that slides in', low=0.0, high=0.9
    )
    person: float = internal(
        0.0, 'Height of a passer-by, share of the image; a third as wide', low=0.0, high=1.5
    )
    GONE: ClassVar[Mapping[str, Any]] = {
        'occlusion_from': 'nowhere',
        'light_period': 120.0,
        'shadow': 0.0,
        'shadow_width': 0.3,
        'motion_blur': 0.0,
        'blur_angle': 0.0,
        'extra_noise': 0.0,
    }

    def __post_init__(self) -> None:
        super().__post_init__()
        if 0 < self.disturbed_every < self.disturbed_for:
            raise ValueError(
                f'disturbed_every must be 0 or at least disturbed_for, got {self.disturbed_every} '
                f'and {self.disturbed_for} frames; one disturbance ends before the next begins'
            )


class Disturbances:
    """Disturbs images of one ``size``, width and height [px], before a sensor takes them."""

    def __init__(self, size: tuple[int, int], settings: DisturbanceSettings, seed: int) -> None:
        self.settings, self._size = settings, size
        self._occluders: list[Occluder] = []
        for number, (share, occluder) in enumerate(
            ((settings.occlusion, board), (settings.person, person))
        ):
            if share > 0.0:
                rng = np.random.default_rng((seed, 5, number))
                self._occluders.append(occluder(size, share, rng))

    def apply(self, image: Image, frame: int) -> Image:
        """Return a disturbed copy of ``image``, shape (H, W), for ``frame``: 0, 1, ..."""
        progress = self._progress(frame)
        image = brightened(as_gray(image), light(self.settings, frame))
        if progress is not None:
            for occluder in self._occluders:
                occluder.draw(image, progress)
        return image

    def hides(self, pixels: FloatArray, frame: int) -> BoolArray:
        """Return at which ``pixels``, shape (N, 2), an occluder hides the scene, shape (N,)."""
        progress, (width, height) = self._progress(frame), self._size
        if progress is None or not self._occluders:
            return np.zeros(len(pixels), bool)
        # One row and column more: numbers -1, and those beyond the image, which nothing hides.
        hidden = np.zeros((height + 1, width + 1), bool)
        for occluder in self._occluders:
            hidden[:-1, :-1] |= occluder.cover(self._size, progress)
        positions = np.clip(np.nan_to_num(pixels, nan=-1.0), -1.0, self._size)
        columns, rows = np.rint(positions).astype(np.int64).T
        return np.asarray(hidden[rows, columns])

    def _progress(self, frame: int) -> float | None:
        """Return how much of the duration has passed, in [0, 1); None before and after."""
        settings, since = self.settings, frame - self.settings.disturbed_from
        if since > 0 and settings.disturbed_every > 0:
            since %= settings.disturbed_every
        share = since / settings.disturbed_for
        return share if 0.0 <= share < 1.0 else None


def light(settings: DisturbanceSettings, frame: int) -> float:
    """Return the factor of the light in ``frame``: a step that stays, and a wave from frame 0."""
    stepped = 1.0 + (settings.light_step if frame >= settings.disturbed_from else 0.0)
    wave = math.sin(2.0 * math.pi * frame / 120.0)
    return stepped * (1.0 + settings.light_wave * wave)
