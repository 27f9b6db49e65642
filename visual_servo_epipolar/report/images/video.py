"""Video of a run: the camera picture beside the live map, one frame a control step."""

from collections.abc import Iterator, Mapping
from contextlib import AbstractContextManager, contextmanager
from dataclasses import dataclass, field
from fractions import Fraction
from importlib import import_module
from pathlib import Path
from typing import Any

import cv2
import numpy as np

from visual_servo_epipolar.core.arrays import FloatArray, Image
from visual_servo_epipolar.core.cameras.model import CameraModel, field_of_view
from visual_servo_epipolar.core.errors import InputError
from visual_servo_epipolar.core.geometry.epipolar import (
    Bearings,
    fundamental_from_bearings,
    in_pixels,
)
from visual_servo_epipolar.core.geometry.motion import HALF_PI, wrap_angle
from visual_servo_epipolar.core.laws.registry import phase_colour
from visual_servo_epipolar.core.servo.run_log import Sample
from visual_servo_epipolar.core.tracking.features import Features
from visual_servo_epipolar.report.images.map_view import MapBounds, MapView, WIDTH
from visual_servo_epipolar.report.images.overlay import draw_overlay
from visual_servo_epipolar.report.style import phase_label

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


def picture(
    image: Image,
    features: Features,
    sample: Sample,
    camera: CameraModel,
    size: tuple[int, int] | None = None,
) -> Image:
    """
    Return ``image``, grey of shape (H, W), with features, epipole and epipolar lines.

    Only a pinhole has epipolar lines that are straight: of others they are left out. ``size`` is
    that of the picture, width and height [px]; if not given, the image's.
    """
    has_bearing = bool(np.isfinite(sample.bearing_current))
    u, v = epipole(sample, camera) if has_bearing else (None, None)
    lines = None
    if has_bearing and camera.planar is not None:
        lines = fundamental(sample, camera)
    return draw_overlay(
        image,
        features.current,
        features.desired,
        header=phase_label(sample.phase.value),
        colour=phase_colour(sample.phase.value),
        epipole_current=u,
        horizon=v,
        fundamental=lines,
        size=size,
    )


def epipole(sample: Sample, camera: CameraModel) -> tuple[float, float]:
    """Return where an upright camera sees the goal's camera [px]; nan where it does not."""
    if camera.planar is not None:
        return camera.cx + sample.epipole_current, camera.cy
    bearing = sample.bearing_current
    ((u, v),) = camera.pixels(np.array([[np.sin(bearing), 0.0, np.cos(bearing)]])).tolist()
    return u, v


def fundamental(sample: Sample, camera: CameraModel) -> FloatArray:
    """Return F in pixels, shape (3, 3), of an upright camera with the bearings of ``sample``."""
    psi = HALF_PI - sample.bearing_desired
    phi = wrap_angle(np.pi - sample.bearing_current)
    return in_pixels(fundamental_from_bearings(Bearings(psi, phi)), camera.matrix, camera.matrix)


HEIGHT = 720  # of the video [px]


def view_size(image_size: tuple[int, int]) -> tuple[int, int]:
    """Return width and height [px] of the camera picture in the video; larger ones are shrunk."""
    # Encoders halve the colour planes, hence need even sizes; the map's width is even.
    return 2 * round(0.5 * HEIGHT * image_size[0] / image_size[1]), HEIGHT


class VideoWriter(AbstractContextManager['VideoWriter']):
    """
    Writer of an MP4, one frame a control step; the file appears when the run is complete.

    Use it as a context manager: if the block ends by an exception, or without a frame, there is no
    file. The map shows ``bounds`` at first, and grows if the robot leaves it. Raises InputError if
    no encoder here can write such a file there, or the disk is full.
    """

    def __init__(self, path: Path, fps: float, *, bounds: MapBounds, camera: CameraModel) -> None:
        self.path, self._camera = path, camera
        self._part = path.with_name(f'.{path.stem}.part{path.suffix}')
        self._view = view_size((camera.width, camera.height))
        self.size = self._view[0] + WIDTH, HEIGHT
        self._map, self.frames = MapView(bounds, HEIGHT, field_of_view(camera)), 0
        self._encoder, self.codec = open_encoder(self._part, path, fps, self.size)

    def __exit__(self, kind: type[BaseException] | None, *_: object) -> None:
        try:
            self._encoder.release()
            if kind is None and self.frames and self._part.exists():
                self._part.replace(self.path)
        finally:
            self._part.unlink(missing_ok=True)

    @property
    def advice(self) -> str:
        """One line on what to install where no browser plays the video; empty where they do."""
        if self.codec.in_browsers:
            return ''
        return (
            f'{self.path.name} is for video players: browsers play no {self.codec.name}; for one '
            f'that they play, install PyAV ({WHAT_TO_INSTALL})'
        )

    def add(self, image: Image, features: Features, sample: Sample) -> None:
        """Add one control step: what the camera saw, shape (H, W), its features, what was done."""
        self._map.add(sample)
        drawn = picture(image, features, sample, self._camera, self._view)
        self._encoder.write(np.hstack([drawn, self._map.picture()]))
        self.frames += 1
