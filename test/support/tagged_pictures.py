"""Picture files with orientation tags, and with headers that claim what is not there."""

import io
import struct
import zlib

import numpy as np
from PIL import Image as Picture

TAGS = range(1, 9)
ORIENTATION = 274
KINDS = ('jpeg', 'png', 'webp', 'tiff', 'tiff, big endian', 'tiff, big')


def tagged(image: np.ndarray, kind: str, tag: int) -> bytes:
    """Return a grey picture, nearly or exactly as it is, that tells how to turn it."""
    if kind.startswith('tiff'):
        return tiff(image, '>' if 'endian' in kind else '<', wide=kind == 'tiff, big', tag=tag)
    exif, file = Picture.Exif(), io.BytesIO()
    exif[ORIENTATION] = tag
    options = {'jpeg': {'quality': 98}, 'webp': {'lossless': True}}.get(kind, {})
    Picture.fromarray(image).save(file, kind, exif=exif.tobytes(), **options)
    return file.getvalue()


def tiff(image: np.ndarray, order: str = '<', *, wide: bool = False, tag: int = 1) -> bytes:
    """Return a grey TIFF of one strip; a ``wide`` one has places of 64 bits."""
    height, width = image.shape
    offset, count = ('Q', 'Q') if wide else ('I', 'H')
    entry = struct.calcsize(f'<HH{offset}{offset}')
    entries = [
        (256, width),
        (257, height),
        (258, 8 * image.itemsize),
        (259, 1),
        (262, 1),
        (273, 0),
        (ORIENTATION, tag),
        (277, 1),
        (278, height),
        (279, image.nbytes),
        (339, {'u': 1, 'i': 2, 'f': 3}[image.dtype.kind]),
    ]
    head = struct.pack(f'{order}2sHHHQ', b'', 43, 8, 0, 16) if wide else b''
    head = head or struct.pack(f'{order}2sHI', b'', 42, 8)
    pixels_at = len(head) + struct.calcsize(f'<{count}') + entry * len(entries)
    pixels_at += struct.calcsize(f'<{offset}')
    directory = struct.pack(f'{order}{count}', len(entries))
    for number, value in entries:
        value = pixels_at if number == 273 else value
        kind, code = (3, 'H') if number == ORIENTATION else (4, 'I')
        packed = struct.pack(f'{order}{code}', value).ljust(struct.calcsize(offset), b'\0')
        directory += struct.pack(f'{order}HH{offset}', number, kind, 1) + packed
    directory += struct.pack(f'{order}{offset}', 0)
    pixels = np.ascontiguousarray(image.astype(image.dtype.newbyteorder(order)))
    return (b'II' if order == '<' else b'MM') + head[2:] + directory + pixels.tobytes()


def huge(kind: str, side: int = 60_000) -> bytes:
    """Return a small picture whose header claims ``side`` by ``side`` pixels."""
    if kind.startswith('tiff'):
        order, wide = '>' if 'endian' in kind else '<', kind == 'tiff, big'
        data = tiff(np.zeros((8, 8), np.uint8), order, wide=wide)
        place, size = (24, 20) if wide else (10, 12)
        for number in range(2):  # width and height come first
            at = place + size * number + (12 if wide else 8)
            data = data[:at] + struct.pack(f'{order}I', side) + data[at + 4 :]
        return data
    data = bytearray(tagged(np.zeros((8, 8), np.uint8), kind, 1))
    if kind == 'png':
        data[16:24] = struct.pack('>II', side, side)
        data[29:33] = struct.pack('>I', zlib.crc32(data[12:29]))
    elif kind == 'jpeg':
        at = data.index(b'\xff\xc0')
        data[at + 5 : at + 9] = struct.pack('>HH', side, side)
    else:  # the canvas of an extended one
        data[24:30] = (side - 1).to_bytes(3, 'little') * 2
    return bytes(data)
