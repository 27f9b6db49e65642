"""
Image encodings: grey levels of 8 bits of sensor_msgs/Image and CompressedImage, and of pictures.

The mosaic of a colour sensor is smoothed by (1 2 1) / 4 along rows and columns, which gives
(R + 2 G + B) / 4 by the same filter at every pixel. Interpolation smooths red, green and blue
pixels in three ways: a corner that moves by one pixel looks another, and is tracked half as well.

The calibration of a camera belongs to the pixels as it stores them: a picture that an orientation
tag turns is refused, as K would have to be turned as well.
"""

from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass
import re
from types import MappingProxyType
from typing import Any

import cv2
import numpy as np

from visual_servo_epipolar.core.arrays import Image

# Compressed as it is: no target is named, or it is the mosaic itself. Else it is colours or grey.
MOSAIC = re.compile(r'(bayer_[rgb]{4}8); ?(?:jpeg|png) compressed *(?:\1)? *')
LARGEST = 2**26  # pixels of a message: a damaged header must not cost gigabytes
STORED = cv2.IMREAD_GRAYSCALE | cv2.IMREAD_ANYDEPTH | cv2.IMREAD_IGNORE_ORIENTATION
JPEG, JPEG_END, JPEG_SCAN = b'\xff\xd8', b'\xff\xd9', 0xDA
FRAME_HEADERS = frozenset({*range(0xC0, 0xD0)} - {0xC4, 0xC8, 0xCC})  # of JPEG, with the size
PNG, PNG_END = b'\x89PNG\r\n\x1a\n', b'IEND'


@dataclass(frozen=True, slots=True)
class Encoding:
    """
    ``channels`` of a byte each a pixel; ``to_gray`` is cv2's conversion, None for grey.

    The colours of a ``planar`` one lie below the image, half as many rows.
    """

    channels: int
    to_gray: int | None = None
    luminance: int | None = None  # the byte that holds it, of two a pixel
    mosaic: bool = False
    planar: bool = False


ENCODINGS: Mapping[str, Encoding] = MappingProxyType(
    {
        **{name: Encoding(1) for name in ('mono8', '8UC1')},
        'bgr8': Encoding(3, cv2.COLOR_BGR2GRAY),
        'rgb8': Encoding(3, cv2.COLOR_RGB2GRAY),
        'bgra8': Encoding(4, cv2.COLOR_BGRA2GRAY),
        'rgba8': Encoding(4, cv2.COLOR_RGBA2GRAY),
        **{f'bayer_{it}8': Encoding(1, mosaic=True) for it in ('rggb', 'bggr', 'gbrg', 'grbg')},
        **{name: Encoding(2, luminance=1) for name in ('yuv422', 'uyvy')},
        **{name: Encoding(2, luminance=0) for name in ('yuv422_yuy2', 'yuyv')},
        **{name: Encoding(1, planar=True) for name in ('nv12', 'yuv420')},
    }
)


def raw(message: Any) -> Image:
    """Return the grey image of a sensor_msgs/Image, or raise ValueError."""
    if message.encoding not in ENCODINGS:
        raise ValueError(
            f'image encoding must be one of {", ".join(ENCODINGS)}, got '
            f'{message.encoding!r:.40}; set the driver to one of them'
        )
    encoding = ENCODINGS[message.encoding]
    rows = _rows(message, encoding)
    if encoding.luminance is not None:
        rows = rows[:, encoding.luminance :: 2]
    elif encoding.channels > 1:
        rows = rows.reshape(len(rows), -1, encoding.channels)
    return _gray(rows, encoding)


def compressed(message: Any) -> Image:
    """Return the grey image of a sensor_msgs/CompressedImage, or raise ValueError."""
    name, data = f'a compressed image ({message.format!r:.40})', bytes(message.data)
    size = _size(data)
    if size is None:
        raise ValueError(
            f'{name} must be a complete JPEG or PNG, got {len(data)} bytes that are not'
        )
    if not 0 < size[0] * size[1] <= LARGEST:
        raise ValueError(
            f'{name} must have 1 to {LARGEST} pixels, got {size[0]}x{size[1]}; it is damaged, or '
            'must be scaled down'
        )
    mosaic = MOSAIC.fullmatch(message.format)
    return _gray(decode(data, name), ENCODINGS[mosaic[1] if mosaic else 'mono8'])


def picture(data: bytes, name: str) -> Image:
    """Return the grey image of a picture file of this ``name``, or raise ValueError."""
    image = decode(data, name)
    turned = cv2.imdecode(np.frombuffer(data, np.uint8), cv2.IMREAD_GRAYSCALE)
    if not np.array_equal(image, turned):
        raise ValueError(
            f'{name} has an orientation tag, which turns its pixels, but not K; store them '
            'upright, without the tag, and calibrate with such images'
        )
    return image


def decode(data: bytes, name: str) -> Image:
    """Return the grey levels of a picture as they are stored, or raise ValueError."""
    try:
        with _silent_opencv():
            image = cv2.imdecode(np.frombuffer(data, np.uint8), STORED) if data else None
    except cv2.error as error:
        raise ValueError(f'{name} cannot be decoded: {error.err}') from None
    if image is None or image.dtype != np.uint8:
        found = 'got none that can be decoded' if image is None else f'got {image.dtype}'
        raise ValueError(f'{name} must be a picture of 8 bits, {found}; give a JPEG or PNG')
    return np.asarray(image, np.uint8)


@contextmanager
def _silent_opencv() -> Iterator[None]:
    """Keep OpenCV from printing what is wrong with a picture: our error says it in one line."""
    log = cv2.utils.logging
    level = log.setLogLevel(log.LOG_LEVEL_SILENT)
    try:
        yield
    finally:
        log.setLogLevel(level)


def _size(data: bytes) -> tuple[int, int] | None:
    """Return width and height of a complete JPEG or PNG by its header; None of anything else."""
    if data.startswith(PNG) and PNG_END in data[-12:]:
        return int.from_bytes(data[16:20], 'big'), int.from_bytes(data[20:24], 'big')
    at = 2
    while data.startswith(JPEG) and at + 9 <= len(data) and data[at + 1] != JPEG_SCAN:
        if data[at + 1] in FRAME_HEADERS and JPEG_END in data[at:]:
            height, width = (int.from_bytes(data[k : k + 2], 'big') for k in (at + 5, at + 7))
            return width, height
        at += 1 if data[at + 1] == 0xFF else 2 + int.from_bytes(data[at + 2 : at + 4], 'big')
    return None


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
    used, size = width * encoding.channels, len(message.data)
    if encoding.planar and row == used + used // 2 and size == height * row:
        row = used  # some drivers count the colours into the rows
    below = height // 2 * row if encoding.planar else 0
    if row < used or size < height * row + below or (size > height * row and not below):
        colours = f', and {below} bytes of colours' if below else ''
        raise ValueError(
            f'image data must hold {height} rows of {row} bytes, at least {used} each{colours}, '
            f'got {size} bytes in all; the message is truncated or mislabelled'
        )
    rows = np.frombuffer(message.data, np.uint8)[: height * row].reshape(height, row)
    return np.asarray(rows[:, :used])
