"""
Image disturbances: light, shadow, occluders and motion between the scene and the sensor.

Everything depends on settings, seed and frame index alone. Each disturbance is off at zero; the
passing ones begin with frame ``disturbed_from``, last for ``disturbed_for`` frames, and come back
after ``disturbed_every``.
"""

from dataclasses import dataclass
from functools import cached_property, lru_cache
import math

import cv2
import numpy as np

from visual_servo_epipolar.core.arrays import as_gray, BoolArray, FloatArray, frozen, Image
from visual_servo_epipolar.core.settings import internal, Settings
from visual_servo_epipolar.simulation.disturbances.occluders import board, Occluder, person
from visual_servo_epipolar.simulation.light.exposure import brightened
from visual_servo_epipolar.simulation.mounts.sensor import Sensor, SensorSettings

OPAQUE = 255


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
    light_wave: float = internal(0.0, 'Amplitude of a slow change of light', low=0.0, high=0.9)
    light_period: float = internal(120.0, 'Frames in one wave of light', low=2.0, high=1e6)
    shadow: float = internal(
        0.0, 'Light taken by a shadow that crosses the image', low=0.0, high=1.0
    )
    shadow_width: float = internal(
        0.3, 'Width of that shadow, share of the image', low=0.01, high=2.0
    )
    occlusion: float = internal(0.0, 'Share of the image behind an obstacle', low=0.0, high=0.9)
    occlusion_from: str = internal(
        'nowhere', 'Whence the obstacle comes: at once, or slides in', choices=('nowhere', 'side')
    )
    person: float = internal(
        0.0, 'Height of a passer-by, share of the image; a third as wide', low=0.0, high=1.5
    )
    motion_blur: float = internal(0.0, 'Length of the motion blur [px]', low=0.0, high=100.0)
    blur_angle: float = internal(
        0.0, 'Direction of the blur, from right to down [rad]', low=-math.pi, high=math.pi
    )
    extra_noise: float = internal(
        0.0, 'Extra noise, standard deviation [grey levels]', low=0.0, high=50.0
    )

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
        self.settings, self._size, self._seed = settings, size, seed
        self._occluders: list[Occluder] = []
        if settings.occlusion > 0.0:
            slides = settings.occlusion_from == 'side'
            self._occluders.append(board(size, settings.occlusion, slides, self._generator(0)))
        if settings.person > 0.0:
            self._occluders.append(person(size, settings.person, self._generator(1)))

    def apply(self, image: Image, frame: int) -> Image:
        """Return a disturbed copy of ``image``, shape (H, W), for ``frame``: 0, 1, ..."""
        settings, progress = self.settings, self._progress(frame)
        lit = brightened(as_gray(image), light(settings, frame))
        image = lit.copy() if lit is image else lit
        if progress is not None:
            if settings.shadow > 0.0:
                band = shadow_band(self._size, settings.shadow, settings.shadow_width)
                image = shade(image, band, progress)
            for occluder in self._occluders:
                occluder.draw(image, progress)
            if settings.motion_blur > 0.0:
                kernel = blur_kernel(settings.motion_blur, settings.blur_angle)
                image = np.asarray(cv2.filter2D(image, -1, kernel), dtype=np.uint8)
            if settings.extra_noise > 0.0:
                image = self._noise.capture(image, frame)
        return image

    def hides(self, pixels: FloatArray, frame: int) -> BoolArray:
        """Return at which ``pixels``, shape (N, 2), an occluder hides the scene, shape (N,)."""
        progress, (width, height) = self._progress(frame), self._size
        hidden = np.zeros(len(pixels), bool)
        if progress is None or not self._occluders:
            return hidden
        positions = np.nan_to_num(pixels, nan=-1.0)
        # Far outside there is nothing: whole numbers need not hold what is far outside.
        columns, rows = np.rint(np.clip(positions, -1.0, [width, height])).astype(np.int64).T
        for occluder in self._occluders:
            hidden |= occluder.hides(columns, rows, progress)
        inside = (columns >= 0) & (columns < width) & (rows >= 0) & (rows < height)
        return np.asarray(hidden & inside)

    def passes(self, frame: int) -> bool:
        """Return whether ``frame`` is one in which something passes."""
        return self._progress(frame) is not None

    def _progress(self, frame: int) -> float | None:
        """Return how much of the duration has passed, in [0, 1); None before and after."""
        settings, since = self.settings, frame - self.settings.disturbed_from
        if since > 0 and settings.disturbed_every > 0:
            since %= settings.disturbed_every
        share = since / settings.disturbed_for
        return share if 0.0 <= share < 1.0 else None

    @cached_property
    def _noise(self) -> Sensor:
        # A seed of its own: the sensor that takes the image has its noise from the plain one.
        extra = SensorSettings(noise=self.settings.extra_noise)
        return Sensor(self._size, extra, int(self._generator(2).integers(2**31)))

    def _generator(self, number: int) -> np.random.Generator:
        return np.random.default_rng((self._seed, 5, number))


def light(settings: DisturbanceSettings, frame: int) -> float:
    """Return the factor of the light in ``frame``: a step that stays, and a wave from frame 0."""
    stepped = 1.0 + (settings.light_step if frame >= settings.disturbed_from else 0.0)
    wave = math.sin(2.0 * math.pi * frame / settings.light_period)
    return stepped * (1.0 + settings.light_wave * wave)


@lru_cache(maxsize=4)
def shadow_band(size: tuple[int, int], depth: float, width: float) -> Image:
    """
    Return the light under a slanted band with soft edges, shape (rows, columns), 255 = all of it.

    It is wide enough that a window of ``size`` (width, height) slides over it from light to light;
    ``width`` is the band's, as a share of the image's. The edges are as soft as a third of it.
    """
    columns, rows = size
    band, slant = width * columns, 0.25 * rows
    length = round(2 * columns + band + slant)
    u = np.arange(length) - 0.5 * length
    v = (np.arange(rows) / rows - 0.5) * slant
    distance = np.abs(u[None, :] - v[:, None]) - 0.5 * band
    softness = band / 3.0
    inside = np.clip(0.5 - distance / softness, 0.0, 1.0)
    smooth = inside * inside * (3.0 - 2.0 * inside)
    return frozen(np.rint(OPAQUE * (1.0 - depth * smooth)).astype(np.uint8))


def shade(image: Image, band: Image, progress: float) -> Image:
    """
    Return ``image``, shape (H, W), under the shadow ``band``, shape (H, L).

    The band moves right as ``progress`` runs from 0 to 1.
    """
    width = image.shape[1]
    left = round((1.0 - progress) * (band.shape[1] - width))
    shade = band[:, left : left + width]
    return np.asarray(cv2.multiply(image, shade, scale=1.0 / OPAQUE), dtype=np.uint8)


@lru_cache(maxsize=4)
def blur_kernel(length: float, angle: float) -> FloatArray:
    """
    Return the kernel, shape (K, L), of a steady motion by ``length`` [px] along ``angle`` [rad].

    It is centred, so that the blurred image is that of the middle of the exposure; its sum is 1.
    """
    reach = math.ceil(0.5 * length) + 1
    kernel = np.zeros((2 * reach + 1, 2 * reach + 1))
    along = length * ((np.arange(64) + 0.5) / 64 - 0.5)
    for u, v in zip(along * math.cos(angle) + reach, along * math.sin(angle) + reach, strict=True):
        column, row = math.floor(u), math.floor(v)
        right, down = u - column, v - row
        weights = np.outer([1.0 - down, down], [1.0 - right, right])
        kernel[row : row + 2, column : column + 2] += weights / 64
    rows = np.flatnonzero(kernel.sum(axis=1) > 1e-9)  # a level blur needs one row only
    half = max(reach - rows[0], rows[-1] - reach)
    return frozen(kernel[reach - half : reach + half + 1])
