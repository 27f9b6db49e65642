"""
Image encodings: grey levels from sensor_msgs/Image, and from JPEG and PNG.

Of 16 bits those that the sensor uses count: their upper eight are the grey levels. The mosaic of a
colour sensor is smoothed by (1 2 1) / 4 along rows and columns, which gives (R + 2 G + B) / 4 by
the same filter at every pixel. Interpolation smooths red, green and blue pixels in three ways: a
corner that moves by one pixel looks another, and is tracked half as well.
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

LARGEST = 2**26  # pixels of a compressed image: a damaged header must not cost gigabytes
PNG, PNG_END = b'\x89PNG\r\n\x1a\n', b'IEND'
JPEG, JPEG_END = b'\xff\xd8', b'\xff\xd9'
MOSAIC = re.compile(r'(bayer_[rgb]{4}8); ?jpeg compressed *')  # in a JPEG, not yet colours
UNTOUCHED = cv2.IMREAD_GRAYSCALE | cv2.IMREAD_ANYDEPTH | cv2.IMREAD_IGNORE_ORIENTATION
DEPTHS = (8, 10, 12, 14, 16)  # bits of sensors, sent as 16
BRIGHT, DARK = 3, 300  # images in a row that tell of more bits than known, and of fewer
FRAME_HEADERS = frozenset({*range(0xC0, 0xD0)} - {0xC4, 0xC8, 0xCC})  # of JPEG, with the size


@dataclass(frozen=True, slots=True)
class Encoding:
    """``channels`` of ``depth`` bytes a pixel; ``to_gray`` is cv2's conversion, None for grey."""

    channels: int
    to_gray: int | None = None
    depth: int = 1
    luminance: int | None = None  # the byte that holds it, of two a pixel
    mosaic: bool = False


_MOSAICS = ('rggb', 'bggr', 'gbrg', 'grbg')
ENCODINGS: Mapping[str, Encoding] = MappingProxyType(
    {
        'mono8': Encoding(1),
        '8UC1': Encoding(1),
        'bgr8': Encoding(3, cv2.COLOR_BGR2GRAY),
        'rgb8': Encoding(3, cv2.COLOR_RGB2GRAY),
        '8UC3': Encoding(3, cv2.COLOR_BGR2GRAY),
        'bgra8': Encoding(4, cv2.COLOR_BGRA2GRAY),
        'rgba8': Encoding(4, cv2.COLOR_RGBA2GRAY),
        '8UC4': Encoding(4, cv2.COLOR_BGRA2GRAY),
        'mono16': Encoding(1, depth=2),
        '16UC1': Encoding(1, depth=2),
        'bgr16': Encoding(3, cv2.COLOR_BGR2GRAY, depth=2),
        'rgb16': Encoding(3, cv2.COLOR_RGB2GRAY, depth=2),
        **{f'bayer_{name}8': Encoding(1, mosaic=True) for name in _MOSAICS},
        **{f'bayer_{name}16': Encoding(1, depth=2, mosaic=True) for name in _MOSAICS},
        **{name: Encoding(2, luminance=1) for name in ('yuv422', 'uyvy')},
        **{name: Encoding(2, luminance=0) for name in ('yuv422_yuy2', 'yuyv')},
    }
)


class GrayReader:
    """
    Reader of the images of one camera as grey levels, uint8 of shape (H, W).

    It remembers how many of 16 bits the sensor uses, which a dark image does not tell. One image
    with more of them is refused as damaged, and not remembered: those of a sensor come again.
    """

    def __init__(self) -> None:
        self._bits = 0  # not known yet
        self._brighter = self._darker = 0  # images in a row

    def raw(self, message: Any) -> Image:
        """Return the grey image of a sensor_msgs/Image, or raise ValueError."""
        encoding = ENCODINGS.get(message.encoding)
        if encoding is None:
            raise ValueError(
                f'image encoding must be one of {", ".join(ENCODINGS)}, got '
                f'{message.encoding!r:.40}; convert it before it gets here'
            )
        rows = _rows(message, encoding.channels * encoding.depth)
        if encoding.depth == 2:
            order = '>u2' if message.is_bigendian else '<u2'
            rows = self._scaled(np.ascontiguousarray(rows).view(order))
        if encoding.luminance is not None:
            rows = rows[:, encoding.luminance :: 2]
        if encoding.channels > 1 and encoding.luminance is None:
            rows = rows.reshape(len(rows), -1, encoding.channels)
        return _gray(rows, encoding)

    def compressed(self, message: Any) -> Image:
        """Return the grey image of a sensor_msgs/CompressedImage, or raise ValueError."""
        image = _decoded(message)
        if image.dtype == np.uint16:
            image = self._scaled(image)
        mosaic = MOSAIC.fullmatch(message.format)
        encoding = ENCODINGS.get(mosaic[1]) if mosaic else None
        return np.asarray(image, dtype=np.uint8) if encoding is None else _gray(image, encoding)

    def _scaled(self, values: NDArray[Any]) -> Image:
        """Return those eight bits of ``values`` that are the upper ones of what is used."""
        used = int(values.max()).bit_length()
        bits = next(bits for bits in DEPTHS if bits >= used)
        self._brighter = self._brighter + 1 if bits > self._bits else 0
        self._darker = self._darker + 1 if bits < self._bits else 0
        if not self._bits or self._brighter >= BRIGHT or self._darker >= DARK:
            self._bits, self._brighter, self._darker = bits, 0, 0
        if bits > self._bits:
            raise ValueError(
                f'an image has grey levels of {bits} bits, those before it {self._bits}; '
                'it is damaged, or the sensor has been set otherwise'
            )
        return (values >> (self._bits - 8)).astype(np.uint8)


def _gray(pixels: Image, encoding: Encoding) -> Image:
    """Return ``pixels``, shape (H, W) or (H, W, channels), as grey levels."""
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
            f'an image of {width}x{height} px cannot become grey: {error.err}; check the driver'
        ) from None


def _rows(message: Any, pixel_bytes: int) -> Image:
    """Return the bytes of the image row by row, without padding, shape (H, W * pixel_bytes)."""
    height, width, row = int(message.height), int(message.width), int(message.step)
    if height < 1 or width < 1:
        raise ValueError(f'image is empty, {width}x{height}; check the camera driver')
    if row < width * pixel_bytes or len(message.data) != height * row:
        raise ValueError(
            f'image data must hold {height} rows of {row} bytes, at least {width * pixel_bytes} '
            f'each, got {len(message.data)} bytes in all; the message is truncated or mislabelled'
        )
    rows = np.frombuffer(message.data, np.uint8).reshape(height, row)
    return np.asarray(rows[:, : width * pixel_bytes])


def _decoded(message: Any) -> NDArray[Any]:
    """Return the picture in a sensor_msgs/CompressedImage, (H, W), or raise ValueError."""
    data = bytes(message.data)
    size = _picture_size(data) if _is_whole(data) else None
    if size is None:
        raise ValueError(
            f'a compressed image must be a whole JPEG or PNG, got {message.format!r:.40} of '
            f'{len(data)} bytes; decompress it before it gets here'
        )
    if not 0 < size[0] * size[1] <= LARGEST:
        raise ValueError(
            f'a compressed image must have 1 to {LARGEST} pixels, got {size[0]}x{size[1]}; the '
            'message is damaged'
        )
    try:
        image = cv2.imdecode(np.frombuffer(data, np.uint8), UNTOUCHED)
    except cv2.error as error:
        raise ValueError(f'a compressed image cannot be decoded: {error.err}') from None
    if image is None:
        raise ValueError('a compressed image cannot be decoded; the message is damaged')
    return np.asarray(image)


def _is_whole(data: bytes) -> bool:
    """Return whether the picture has its end: decoders only warn when it has not."""
    return data.rstrip(b'\0').endswith(JPEG_END) or PNG_END in data[-12:]


def _picture_size(data: bytes) -> tuple[int, int] | None:
    """Return width and height as a JPEG or PNG states them, None for anything else."""
    if data.startswith(PNG) and len(data) >= 24:
        return int.from_bytes(data[16:20], 'big'), int.from_bytes(data[20:24], 'big')
    at = 2 if data.startswith(JPEG) else len(data)
    while at + 9 <= len(data) and data[at] == 0xFF:
        if data[at + 1] in FRAME_HEADERS:
            height, width = data[at + 5 : at + 7], data[at + 7 : at + 9]
            return int.from_bytes(width, 'big'), int.from_bytes(height, 'big')
        at += 1 if data[at + 1] == 0xFF else 2 + int.from_bytes(data[at + 2 : at + 4], 'big')
    return None
