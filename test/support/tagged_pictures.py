"""Picture files with orientation tags, and with headers that claim what is not there."""

import io
import struct
import zlib

import numpy as np
from PIL import Image as Picture

TAGS = range(1, 9)
ORIENTATION = 274


def tagged(image: np.ndarray, kind: str, tag: int) -> bytes:
    """Return a grey JPEG or PNG, nearly or exactly as it is, that tells how to turn it."""
    exif, file = Picture.Exif(), io.BytesIO()
    exif[ORIENTATION] = tag
    options = {'quality': 98} if kind == 'jpeg' else {}
    Picture.fromarray(image).save(file, kind, exif=exif.tobytes(), **options)
    return file.getvalue()


def huge(kind: str, side: int = 60_000) -> bytes:
    """Return a small JPEG or PNG whose header claims ``side`` by ``side`` pixels."""
    data = bytearray(tagged(np.zeros((8, 8), np.uint8), kind, 1))
    if kind == 'png':
        data[16:24] = struct.pack('>II', side, side)
        data[29:33] = struct.pack('>I', zlib.crc32(data[12:29]))
    else:
        at = data.index(b'\xff\xc0')
        data[at + 5 : at + 9] = struct.pack('>HH', side, side)
    return bytes(data)
