"""
Encoders of a video: PyAV where it is installed, otherwise OpenCV.

Browsers play H.264 and VP9, no MPEG-4 part 2, which is what every wheel of OpenCV can write. PyAV
is FFmpeg with all its options. It is optional: what runs on a robot needs no video.
"""

from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass, field
from fractions import Fraction
from importlib import import_module
from pathlib import Path
from typing import Any

import cv2

from visual_servo_epipolar.core.arrays import Image
from visual_servo_epipolar.core.errors import InputError

WHAT_TO_INSTALL = 'pip install av, or apt install python3-av'


@dataclass(frozen=True)
class Codec:
    """Codec by its name in FFmpeg, with ``options`` for PyAV; without any it is OpenCV's."""

    name: str
    options: Mapping[str, str] = field(default_factory=dict)

    @property
    def in_browsers(self) -> bool:
        """Whether Chromium and Firefox play it."""
        return bool(self.options)

    def open(self, path: Path, fps: float, size: tuple[int, int]) -> Any:
        """Return the encoder for a file, with write and release; None if this machine has none."""
        if not self.options:
            writer = cv2.VideoWriter(str(path), cv2.VideoWriter.fourcc(*self.name), fps, size)
            return writer if writer.isOpened() else None
        av = pyav()
        if av is None or self.name not in av.codecs_available:
            return None
        try:
            return AvEncoder(self, path, fps, size, av)
        except (av.error.FFmpegError, ValueError):  # listed, but its library cannot be loaded
            return None


# Camera noise is most of what is to be encoded: nr takes some of it out, crf lets the rest go.
# A key frame every 10 s is what a browser can jump to. One thread costs a tenth less than many;
# without frames predicted from later ones it takes a fifth less time, for a fifth more bytes.
_X264 = {
    'preset': 'superfast',
    'crf': '30',
    'x264-params': 'nr=1000:threads=1:bframes=0:weightp=0',
    'g': '110',
}
_VPX = {'deadline': 'realtime', 'cpu-used': '8', 'row-mt': '1', 'crf': '46', 'b': '0', 'g': '110'}

# Codecs to try, the best first.
CODECS = (Codec('libx264', _X264), Codec('libvpx-vp9', _VPX), Codec('mp4v'))


def open_encoder(part: Path, path: Path, fps: float, size: tuple[int, int]) -> tuple[Any, Codec]:
    """
    Open the first encoder that works for ``path``, an MP4, writing to ``part``.

    Raises InputError if none does.
    """
    if not path.parent.is_dir():
        raise InputError(f'{path.parent} must be a folder to write {path.name} to; create it')
    for codec in CODECS:
        encoder = codec.open(part, fps, size)
        if encoder is not None:
            return encoder, codec
        part.unlink(missing_ok=True)
    raise InputError(
        f'{path} needs one of the encoders {", ".join(codec.name for codec in CODECS)}, and none '
        f'opened; install PyAV ({WHAT_TO_INSTALL}), or check that the folder is writable'
    )


class AvEncoder:
    """Encoder by PyAV, of any version since 10; called as cv2.VideoWriter is."""

    def __init__(
        self, codec: Codec, path: Path, fps: float, size: tuple[int, int], av: Any
    ) -> None:
        self._av, self._path, self._frames = av, path, 0
        rate = Fraction(fps).limit_denominator(1000)
        self._time_base = 1 / rate
        # The index comes first, so that a page can play what it has so far.
        self._container = av.open(str(path), 'w', options={'movflags': '+faststart'})
        try:
            self._stream = self._container.add_stream(codec.name, rate=rate)
            self._stream.options, self._stream.pix_fmt = dict(codec.options), 'yuv420p'
            self._stream.width, self._stream.height = size
            self._stream.codec_context.time_base = self._time_base
            self._stream.codec_context.open()
        except (av.error.FFmpegError, ValueError):
            self._container.close()
            raise

    def write(self, frame: Image) -> None:
        """Append a frame, BGR; raises InputError if the file cannot be written."""
        planes = cv2.cvtColor(frame, cv2.COLOR_BGR2YUV_I420)
        picture = self._av.VideoFrame.from_ndarray(planes, format='yuv420p')
        picture.pts, picture.time_base = self._frames, self._time_base
        with self._raise_input_errors():
            self._container.mux(self._stream.encode(picture))
        self._frames += 1

    def release(self) -> None:
        """Write what the encoder still holds, and the index; raises InputError as ``write``."""
        container, self._container = self._container, None
        if container is None:
            return
        with self._raise_input_errors():
            if self._frames:
                container.mux(self._stream.encode())
            container.close()

    @contextmanager
    def _raise_input_errors(self) -> Iterator[None]:
        try:
            yield
        except self._av.error.FFmpegError as error:
            self._container = None  # closed after a failure, some versions crash
            raise InputError(
                f'{self._path.parent}: the video cannot be written: {error.strerror}; make room '
                'there, or leave the video out'
            ) from None


def pyav() -> Any:
    """Return PyAV, or None where it is not installed."""
    try:
        import_module('av.logging').set_level(0)  # older ones log every start of an encoder
        return import_module('av')
    except ImportError:
        return None
