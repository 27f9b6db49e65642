"""
Image encodings: grey levels from sensor_msgs/Image and CompressedImage, and from picture files.

Of 16 bits those that the sensor uses count: their upper eight are the grey levels; in the dark,
where the upper ones stay empty, the eight below, as little would be left of the upper ones.

The mosaic of a colour sensor is smoothed by (1 2 1) / 4 along rows and columns, which gives
(R + 2 G + B) / 4 by the same filter at every pixel. Interpolation smooths red, green and blue
pixels in three ways: a corner that moves by one pixel looks another, and is tracked half as well.
"""

from collections.abc import Mapping
from dataclasses import dataclass
import re
from types import MappingProxyType
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from visual_servo_epipolar.core.arrays import Image
from visual_servo_epipolar.messages.pictures import decode, LARGEST_FILE

# Compressed as it is: no target is named, or it is the mosaic itself. Else it is colours or grey.
MOSAIC = re.compile(r'(bayer_[rgb]{4}(?:8|16)); ?(?:jpeg|png|tiff) compressed *(?:\1)? *')
DEPTHS = (8, 10, 12, 14, 16)  # bits of sensors, sent as 16
BRIGHT, DARK = 3, 300  # images in a row that tell of more bits than known, and of fewer
DIM_BITS = 2  # that are empty in the dark
LAMPS, SAMPLES = 95.0, 64  # percentile, of so many rows: what is brighter may be lamps


@dataclass(frozen=True, slots=True)
class Encoding:
    """
    ``channels`` of ``depth`` bytes a pixel; ``to_gray`` is cv2's conversion, None for grey.

    ``chroma`` rows of colours, a row of the image, lie below the image in planes of their own.
    """

    channels: int
    to_gray: int | None = None
    depth: int = 1
    luminance: int | None = None  # the byte that holds it, of two a pixel
    mosaic: bool = False
    chroma: float = 0.0


_MOSAICS = ('rggb', 'bggr', 'gbrg', 'grbg')
ENCODINGS: Mapping[str, Encoding] = MappingProxyType(
    {
        'mono8': Encoding(1),
        '8UC1': Encoding(1),
        'bgr8': Encoding(3, cv2.COLOR_BGR2GRAY),
        'rgb8': Encoding(3, cv2.COLOR_RGB2GRAY),
        'bgra8': Encoding(4, cv2.COLOR_BGRA2GRAY),
        'rgba8': Encoding(4, cv2.COLOR_RGBA2GRAY),
        'mono16': Encoding(1, depth=2),
        '16UC1': Encoding(1, depth=2),
        **{f'bayer_{name}8': Encoding(1, mosaic=True) for name in _MOSAICS},
        **{f'bayer_{name}16': Encoding(1, depth=2, mosaic=True) for name in _MOSAICS},
        **{name: Encoding(2, luminance=1) for name in ('yuv422', 'uyvy')},
        **{name: Encoding(2, luminance=0) for name in ('yuv422_yuy2', 'yuyv')},
        **{name: Encoding(1, chroma=0.5) for name in ('nv12', 'nv21', 'yuv420')},
        'nv24': Encoding(1, chroma=2.0),
    }
)


class GrayReader:
    """
    Reader of the images of one camera as grey levels, uint8 of shape (H, W).

    It remembers how many of 16 bits the sensor uses, which a dark image does not tell. One image
    with more of them is refused as damaged, and not remembered: those of a sensor come again.
    Images that get dark, or bright again, change by a power of two once.
    """

    def __init__(self) -> None:
        self._bits = 0  # not known yet
        self._brighter = self._darker = 0  # images in a row
        self._empty = 0  # upper bits that are empty in the dark

    def raw(self, message: Any) -> Image:
        """Return the grey image of a sensor_msgs/Image, or raise ValueError."""
        if message.encoding not in ENCODINGS:
            raise ValueError(
                f'image encoding must be one of {", ".join(ENCODINGS)}, got '
                f'{message.encoding!r:.40}; set the driver to one of them'
            )
        encoding = ENCODINGS[message.encoding]
        rows = _rows(message, encoding)
        if encoding.depth == 2:
            order = '>u2' if message.is_bigendian else '<u2'
            rows = self._upper_bits(np.ascontiguousarray(rows).view(order))
        if encoding.luminance is not None:
            rows = rows[:, encoding.luminance :: 2]
        if encoding.channels > 1 and encoding.luminance is None:
            rows = rows.reshape(len(rows), -1, encoding.channels)
        return _gray(rows, encoding)

    def compressed(self, message: Any) -> Image:
        """Return the grey image of a sensor_msgs/CompressedImage, or raise ValueError."""
        name = f'a compressed image ({message.format!r:.40})'
        mosaic = MOSAIC.fullmatch(message.format)
        encoding = ENCODINGS[mosaic[1] if mosaic else 'mono8']
        return self._gray_of_picture(decode(bytes(message.data), name), encoding)

    def picture(self, data: bytes, name: str, *, turn: bool = False) -> Image:
        """Return the grey image of a picture file of this ``name``, as ``decode`` does."""
        image = decode(data, name, largest=LARGEST_FILE, turn=turn)
        return self._gray_of_picture(image, ENCODINGS['mono8'])

    def _gray_of_picture(self, image: NDArray[Any], encoding: Encoding) -> Image:
        return _gray(self._upper_bits(image) if image.dtype == np.uint16 else image, encoding)

    def _upper_bits(self, values: NDArray[Any]) -> Image:
        """Return those eight bits of ``values`` that are the upper ones of what is used now."""
        used = int(values.max()).bit_length()
        bits = next(bits for bits in DEPTHS if bits >= used)
        self._brighter = self._brighter + 1 if bits > self._bits else 0
        self._darker = self._darker + 1 if bits < self._bits else 0
        if not self._bits or self._brighter >= BRIGHT or self._darker >= DARK:
            self._bits, self._brighter, self._darker = bits, 0, 0
        if bits > self._bits:
            raise ValueError(
                f'an image has grey levels of {bits} bits, earlier ones {self._bits}; '
                'it is damaged, or the sensor was set differently'
            )
        self._empty = self._empty_bits(values)
        if not self._empty:
            return (values >> (self._bits - 8)).astype(np.uint8)
        values = np.minimum(values >> (self._bits - 8 - self._empty), 255)
        return np.asarray(values, dtype=np.uint8)

    def _empty_bits(self, values: NDArray[Any]) -> int:
        """Return how many upper bits of ``values`` to leave out: as before, or what is empty."""
        stride = max(min(values.shape[:2]) // SAMPLES, 1)
        used = int(np.percentile(values[::stride, ::stride], LAMPS)).bit_length()
        empty = self._bits - max(used, 8)
        return empty if empty < self._empty or empty >= self._empty + DIM_BITS else self._empty


def _gray(pixels: Image, encoding: Encoding) -> Image:
    pixels = np.ascontiguousarray(pixels)
    if encoding.mosaic:  # reflected at its edges, where colours go on as they alternate
        return np.asarray(cv2.GaussianBlur(pixels, (3, 3), 0), dtype=np.uint8)
    if encoding.to_gray is None:
        return pixels
    try:
        return np.asarray(cv2.cvtColor(pixels, encoding.to_gray), dtype=np.uint8)
    except cv2.error as error:
        height, width = pixels.shape[:2]
        raise ValueError(
            f'an image of {width}x{height} px cannot be converted to grey: {error.err}; check '
            'the driver'
        ) from None


def _rows(message: Any, encoding: Encoding) -> Image:
    """Return the bytes of the image row by row, without padding, shape (H, bytes of a row)."""
    height, width, row = int(message.height), int(message.width), int(message.step)
    if height < 1 or width < 1:
        raise ValueError(f'image is empty, {width}x{height}; check the camera driver')
    used, size = width * encoding.channels * encoding.depth, len(message.data)
    if encoding.chroma and row == used + int(used * encoding.chroma) and size == height * row:
        row = used  # some drivers count the colours into the rows
    below = int(height * encoding.chroma) * row
    if row < used or size < height * row + below or (size > height * row and not below):
        colours = f', and {below} bytes of colours' if below else ''
        raise ValueError(
            f'image data must hold {height} rows of {row} bytes, at least {used} each{colours}, '
            f'got {size} bytes in all; the message is truncated or mislabelled'
        )
    rows = np.frombuffer(message.data, np.uint8)[: height * row].reshape(height, row)
    return np.asarray(rows[:, :used])
