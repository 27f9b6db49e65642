"""A sheet of grey paint measured in metres, and the fractal grain of all materials."""

from collections.abc import Sequence
import math

import cv2
import numpy as np

from visual_servo_epipolar.core.arrays import FloatArray, Image

GRAIN_SIZE = 1024  # the grain repeats after so many texels
GRAIN_DEVIATION = 32.0  # of the grain, grey levels around 128
FINEST = 0.8
SHIFT = 4  # sub-pixel bits of drawing


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
        other = Painting(self.width, self.height, self.density, rng, self.grain)
        other.pixels, other.pictures = self.pixels.copy(), [*self.pictures]
        return other

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

    def polygon(self, points: Sequence[tuple[float, float]] | FloatArray, grey: float) -> None:
        """Fill a polygon with corners [m], shape (N, 2)."""
        texels = (np.asarray(points) * self.density - 0.5) * (1 << SHIFT)
        cv2.fillPoly(
            self.pixels, [np.rint(texels).astype(np.int32)], _level(grey), cv2.LINE_AA, SHIFT
        )

    def line(
        self, points: Sequence[tuple[float, float]] | FloatArray, width: float, grey: float
    ) -> None:
        """Draw a line through points [m], shape (N, 2), at least a texel wide."""
        texels = np.rint((np.asarray(points) * self.density - 0.5) * (1 << SHIFT)).astype(np.int32)
        thickness = max(1, round(width * self.density))
        cv2.polylines(self.pixels, [texels], False, _level(grey), thickness, cv2.LINE_AA, SHIFT)

    def text(self, words: str, x: float, y: float, height: float, grey: float) -> None:
        """Write words with their baseline starting at (x, y), capitals ``height`` tall."""
        at = (round(x * self.density), round(y * self.density))
        scale = height * self.density / 22.0
        weight = max(1, round(scale * 1.6))
        cv2.putText(
            self.pixels,
            words,
            at,
            cv2.FONT_HERSHEY_SIMPLEX,
            scale,
            _level(grey),
            weight,
            cv2.LINE_AA,
        )

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
        rows, columns = (math.ceil(n / z) + 2 for n, z in zip(shape, zoom[::-1], strict=True))
        down, right = self.rng.integers(0, GRAIN_SIZE, 2)
        patch = np.roll(self.grain, (-int(down), -int(right)), (0, 1))
        patch = patch[:: 1 - 2 * int(self.rng.integers(2)), :: 1 - 2 * int(self.rng.integers(2))]
        patch = np.ascontiguousarray(patch[:rows, :columns])
        more = max(0, rows - len(patch)), max(0, columns - patch.shape[1])
        if any(more):
            patch = np.asarray(
                cv2.copyMakeBorder(patch, 0, more[0], 0, more[1], cv2.BORDER_WRAP), np.uint8
            )
        if zoom != (1.0, 1.0):
            size = (round(columns * zoom[0]), round(rows * zoom[1]))
            patch = np.asarray(cv2.resize(patch, size, interpolation=cv2.INTER_CUBIC), np.uint8)
        return patch[: shape[0], : shape[1]]

    def lit(self, field: FloatArray, most: int = 255) -> Image:
        """
        Return the paint, shape (H, W), by a coarse ``field`` of light, shape (H, W), in 0..2.

        It is no brighter than ``most``, and softened so that no edge is sharper than a texel.
        """
        coarse = np.clip(field * 127.5, 0.0, 255.0).astype(np.float32)
        rows, columns = self.pixels.shape
        full = cv2.resize(coarse, (columns, rows), interpolation=cv2.INTER_LINEAR)
        pixels = cv2.multiply(self.pixels, full, scale=1.0 / 127.5, dtype=cv2.CV_8U)
        if most < 255:
            pixels = cv2.min(pixels, most)
        return np.asarray(cv2.GaussianBlur(pixels, (5, 5), 0.6), dtype=np.uint8)


def _level(grey: float) -> float:
    return float(min(255, max(0, round(grey))))
