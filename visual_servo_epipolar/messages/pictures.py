"""
Pictures: the pixels of JPEG, PNG, TIFF, WebP, and of what else OpenCV reads, as they are stored.

The calibration of a camera belongs to the pixels as it stores them: what an orientation tag, of
EXIF or of TIFF's own, turns must turn K as well. A picture that is upside down by its tag is
turned where K is as well, all others with a tag are refused. OpenCV, asked to turn none, turns
those of TIFF.
"""

from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass
from types import MappingProxyType
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

LARGEST = 2**26  # pixels of a message: a damaged header must not cost gigabytes
LARGEST_FILE = 2**30  # OpenCV reads no more
STORED = cv2.IMREAD_GRAYSCALE | cv2.IMREAD_ANYDEPTH | cv2.IMREAD_IGNORE_ORIENTATION
EXPECTED = 'a JPEG, PNG, TIFF or WebP of 8 or 16 bits'
JPEG_END, JPEG_SCAN, JPEG_EXIF = b'\xff\xd9', 0xDA, 0xE1
FRAME_HEADERS = frozenset({*range(0xC0, 0xD0)} - {0xC4, 0xC8, 0xCC})  # of JPEG, with the size
TIFF_WIDTH, TIFF_HEIGHT, ORIENTATION = 256, 257, 274
UPRIGHT, UPSIDE_DOWN = 1, 3  # orientations, of 1 to 8
EXIF, TIFF = b'Exif\0\0', (b'II', b'MM')
TIFF_SIZES = MappingProxyType({3: 2, 4: 4, 16: 8})  # bytes of the types of numbers


@dataclass(frozen=True, slots=True)
class Header:
    """Header of a picture: size [px], whether its end is there (decoders only warn), its tag."""

    width: int
    height: int
    is_whole: bool
    orientation: int = UPRIGHT


def is_upside_down(data: bytes) -> bool:
    """Return whether a picture says by its orientation tag that it is upside down."""
    header = _header(data)
    return header is not None and header.orientation == UPSIDE_DOWN


def decode(data: bytes, name: str, *, largest: int = LARGEST, turn: bool = False) -> NDArray[Any]:
    """
    Return the grey levels of a picture as they are stored, uint8 or uint16 of shape (H, W).

    One that ``is_upside_down`` is turned if whoever asks to ``turn`` it turns K as well.
    ``largest`` limits its pixels by its header, which is read first; with LARGEST_FILE the kind of
    picture may be one whose header is not known here. Raises ValueError, with its ``name``, if it
    cannot be used.
    """
    header = _header(data)
    if header is None and largest < LARGEST_FILE or header is not None and not header.is_whole:
        raise ValueError(
            f'{name} must be a complete JPEG, PNG, TIFF or WebP, got {len(data)} bytes that '
            'are not'
        )
    if header is not None and not 0 < header.width * header.height <= largest:
        raise ValueError(
            f'{name} must have 1 to {largest} pixels, got {header.width}x{header.height}; it is '
            'damaged, or must be scaled down'
        )
    tag = UPRIGHT if header is None else header.orientation
    if tag not in (UPRIGHT, UPSIDE_DOWN if turn else UPRIGHT):
        raise ValueError(
            f'{name} has the orientation tag {tag}, which turns its pixels, but not K; store them '
            'upright, without the tag, and calibrate with such images'
        )
    try:
        with _silent_opencv():
            pixels = np.frombuffer(data, np.uint8)
            image = cv2.imdecode(pixels, STORED) if data else None
    except cv2.error as error:
        raise ValueError(f'{name} cannot be decoded: {error.err}') from None
    if image is None:
        raise ValueError(f'{name}: not an image that can be decoded; give {EXPECTED}')
    if image.dtype not in (np.uint8, np.uint16):
        raise ValueError(
            f'{name}: pixels must be uint8 or uint16, got {image.dtype}; give {EXPECTED}'
        )
    is_turned = tag == UPRIGHT or data.startswith(TIFF)
    return np.asarray(image if is_turned else image[::-1, ::-1])


@contextmanager
def _silent_opencv() -> Iterator[None]:
    """Keep OpenCV from printing what is wrong with a picture: our error says it in one line."""
    log = cv2.utils.logging
    level = log.setLogLevel(log.LOG_LEVEL_SILENT)
    try:
        yield
    finally:
        log.setLogLevel(level)


def _header(data: bytes) -> Header | None:
    """Return the header of a picture, None if it is of no kind that is known here."""
    return next((read(data) for start, read in KINDS.items() if data.startswith(start)), None)


def _of_png(data: bytes) -> Header | None:
    if len(data) < 24:
        return None
    at = 8
    while at < len(data) and data[at + 4 : at + 8] != b'eXIf':
        at += 12 + _big(data[at : at + 4])
    tag = _orientation(data[at + 8 :])
    return Header(_big(data[16:20]), _big(data[20:24]), b'IEND' in data[-12:], tag)


def _of_jpeg(data: bytes) -> Header | None:
    """Walk the segments, thumbnails among them, up to the pixels."""
    at, size, tag = 2, None, UPRIGHT
    while at + 9 <= len(data) and data[at] == 0xFF and data[at + 1] != JPEG_SCAN:
        if data[at + 1] in FRAME_HEADERS:
            size = _big(data[at + 7 : at + 9]), _big(data[at + 5 : at + 7])
        if data[at + 1] == JPEG_EXIF and data.startswith(EXIF, at + 4):
            tag = _orientation(data[at + 4 : at + 2 + _big(data[at + 2 : at + 4])])
        at += 1 if data[at + 1] == 0xFF else 2 + _big(data[at + 2 : at + 4])
    return None if size is None else Header(*size, data.find(JPEG_END, at) > 0, tag)


def _of_webp(data: bytes) -> Header | None:
    """Read the size from the first chunk, which there are three kinds of."""
    if data[8:12] != b'WEBP' or len(data) < 30:
        return None
    if data[12:16] == b'VP8X':
        width, height = _little(data[24:27]) + 1, _little(data[27:30]) + 1
    elif data[12:16] == b'VP8L':
        bits = _little(data[21:25])
        width, height = (bits & 0x3FFF) + 1, (bits >> 14 & 0x3FFF) + 1
    else:
        width, height = _little(data[26:28]) & 0x3FFF, _little(data[28:30]) & 0x3FFF
    at = 12
    while at < len(data) and data[at : at + 4] != b'EXIF':
        at += 8 + _little(data[at + 4 : at + 8]) + _little(data[at + 4 : at + 8]) % 2
    is_whole = len(data) >= 8 + _little(data[4:8])
    return Header(width, height, is_whole, _orientation(data[at + 8 :]))


def _of_tiff(data: bytes) -> Header | None:
    values = _tiff_tags(data)
    if TIFF_WIDTH not in values or TIFF_HEIGHT not in values:
        return None
    return Header(values[TIFF_WIDTH], values[TIFF_HEIGHT], True, _orientation(data))


def _orientation(exif: bytes) -> int:
    """Return the orientation that EXIF tells, a TIFF without pixels; upright without any."""
    tag = _tiff_tags(exif.removeprefix(EXIF)).get(ORIENTATION, UPRIGHT)
    return tag if 1 <= tag <= 8 else UPRIGHT


def _tiff_tags(data: bytes) -> dict[int, int]:
    """Return the numbers of the first image by their tags; BigTIFF has them wider."""
    number, tags = _little if data.startswith(b'II') else _big, {}
    wide = number(data[2:4]) == 43
    directory = number(data[8:16] if wide else data[4:8])
    head, entry, at = (8, 20, 12) if wide else (2, 12, 8)
    count = number(data[directory : directory + head])
    first = directory + head
    for place in range(first, min(first + count * entry, len(data) - entry + 1), entry):
        size = TIFF_SIZES.get(number(data[place + 2 : place + 4]), 0)
        if size:
            tags[number(data[place : place + 2])] = number(data[place + at : place + at + size])
    return tags


def _big(digits: bytes) -> int:
    return int.from_bytes(digits, 'big')


def _little(digits: bytes) -> int:
    return int.from_bytes(digits, 'little')


KINDS: Mapping[bytes, Callable[[bytes], Header | None]] = MappingProxyType(
    {
        b'\xff\xd8': _of_jpeg,
        b'\x89PNG\r\n\x1a\n': _of_png,
        b'RIFF': _of_webp,
        b'II*\0': _of_tiff,
        b'MM\0*': _of_tiff,
        b'II+\0': _of_tiff,
        b'MM\0+': _of_tiff,
    }
)
