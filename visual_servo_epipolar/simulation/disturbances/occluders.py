"""Occluders: what stands or walks between camera and scene."""

from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property, lru_cache
import math

import cv2
import numpy as np

from visual_servo_epipolar.core.arrays import BoolArray, frozen, Image, IntArray
from visual_servo_epipolar.simulation.rooms.textures import fractal_grain

ASPECT = 0.39  # width of a walking person over the height
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

    def hides(self, columns: IntArray, rows: IntArray, progress: float) -> BoolArray:
        """Return at which pixels, (N,) columns and rows, it hides the scene, shape (N,)."""
        mask, (left, top) = self.mask(progress), self.place(progress)
        beside, below = columns - left, rows - top
        hidden = (beside >= 0) & (beside < mask.shape[1]) & (below >= 0) & (below < mask.shape[0])
        hidden[hidden] = mask[below[hidden], beside[hidden]] > 0
        return np.asarray(hidden)


def board(size: tuple[int, int], share: float, slides: bool, rng: np.random.Generator) -> Occluder:
    """Return a textured board over a ``share`` of the image; it stands, or slides in and out."""
    width, height = size
    # Three quarters of the height, unless that makes it wider than the image.
    tall = max(0.75, share)
    wide, high = round(width * share / tall), round(height * tall)
    left, top = (
        round((width - wide) * rng.uniform(0.2, 0.8)),
        round((height - high) * rng.uniform()),
    )
    mask: Image = np.full((high, wide), 255, np.uint8)

    def place(progress: float) -> tuple[int, int]:
        if not slides:
            return left, top
        out = 1.0 - min(progress, 1.0 - progress, SLIDE) / SLIDE
        return round(left + out * (width - left)), top

    def paint() -> Image:
        picture = _grain((wide, high), rng, grey=110.0, contrast=1.2)
        cv2.rectangle(picture, (6, 6), (wide - 7, high - 7), 30, 4)
        return picture

    return Occluder(place, lambda progress: mask, paint)


def person(size: tuple[int, int], height: float, rng: np.random.Generator) -> Occluder:
    """Return one who walks through the image from left to right, ``height`` of it tall."""
    tall = round(size[1] * height)
    wide, high = max(8, round(ASPECT * tall)), max(16, tall)
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
    return np.asarray(
        cv2.addWeighted(cloth, contrast, cloth, 0.0, grey - 128.0 * contrast), dtype=np.uint8
    )


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
    cv2.ellipse(
        mask, at(0.0, 0.08), (round(0.06 * height), round(0.08 * height)), 0, 0, 360, 255, -1
    )
    cv2.ellipse(
        mask, at(0.0, 0.34), (round(0.28 * width), round(0.2 * height)), 0, 0, 360, 255, -1
    )
    for side in (-1.0, 1.0):
        cv2.line(mask, at(0.08 * side, 0.5), at(0.3 * side * swing, 0.95), 255, thick)
        cv2.line(mask, at(0.22 * side, 0.22), at(-0.36 * side * swing, 0.53), 255, thick // 2)
    return frozen(np.asarray(cv2.GaussianBlur(mask, (0, 0), SOFT), dtype=np.uint8))
