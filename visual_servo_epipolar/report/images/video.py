"""Video of a run: the camera picture beside the live map, one frame a control step."""

from collections.abc import Iterator
from contextlib import AbstractContextManager, contextmanager
from fractions import Fraction
from importlib import import_module
from pathlib import Path
from typing import Any

import cv2
import numpy as np

from visual_servo_epipolar.core.arrays import FloatArray, Image
from visual_servo_epipolar.core.cameras.model import CameraModel, field_of_view
from visual_servo_epipolar.core.cameras.registry import scaled
from visual_servo_epipolar.core.errors import InputError
from visual_servo_epipolar.core.geometry.epipolar import (
    Bearings,
    fundamental_from_bearings,
    in_pixels,
)
from visual_servo_epipolar.core.geometry.motion import HALF_PI, Pose, wrap_angle
from visual_servo_epipolar.core.laws.registry import phase_colour
from visual_servo_epipolar.core.servo.run_log import Sample
from visual_servo_epipolar.core.tracking.features import Features
from visual_servo_epipolar.report.images.map_view import MapView, WIDTH
from visual_servo_epipolar.report.images.overlay import draw_overlay
from visual_servo_epipolar.report.style import phase_label

WHAT_TO_INSTALL = 'pip install av, or apt install python3-av'
FIRST = {'movflags': '+faststart'}


# Camera noise is most of what is to be encoded: nr takes some of it out, crf lets the rest go.
# A key frame every 10 s is what a browser can jump to. One thread costs a tenth less than many;
# without frames predicted from later ones it takes a fifth less time, for a fifth more bytes.
OPTIONS = {
    'preset': 'superfast',
    'crf': '30',
    'x264-params': 'nr=1000:threads=1:bframes=0:weightp=0',
    'g': '110',
}


def pyav() -> Any:
    """Return PyAV, or None where it is not installed."""
    try:
        import_module('av.logging').set_level(0)  # older ones log every start of an encoder
        return import_module('av')
    except ImportError:
        return None


HEIGHT = 720  # of the video [px]


def picture(image: Image, features: Features, sample: Sample, camera: CameraModel) -> Image:
    """
    Return ``image``, grey of shape (H, W), HEIGHT high, with features, epipole, epipolar lines.

    Only a pinhole has epipolar lines that are straight: of others they are left out.
    """
    size = view_size((camera.width, camera.height))
    scale = np.array(size) / (camera.width, camera.height)
    camera = scaled(camera, size, *scale.tolist())
    u = v = lines = None
    if np.isfinite(sample.bearing_current):
        # An upright camera sees the goal's camera at (u, v), or it does not: nan.
        bearing = sample.bearing_current
        ((u, v),) = camera.pixels(np.array([[np.sin(bearing), 0.0, np.cos(bearing)]])).tolist()
        lines = None if camera.planar is None else fundamental(sample, camera)
    # Averaging takes longer by far than interpolation, and is needed for strong shrinking.
    kind = cv2.INTER_AREA if scale[1] < 0.5 else cv2.INTER_LINEAR
    return draw_overlay(
        np.asarray(cv2.resize(image, size, interpolation=kind), np.uint8),
        (features.current + 0.5) * scale - 0.5,
        (features.desired + 0.5) * scale - 0.5,
        header=phase_label(sample.phase.value),
        colour=phase_colour(sample.phase.value),
        epipole_current=u,
        horizon=v,
        fundamental=lines,
    )


def fundamental(sample: Sample, camera: CameraModel) -> FloatArray:
    """Return F in pixels, shape (3, 3), of an upright camera with the bearings of ``sample``."""
    psi = HALF_PI - sample.bearing_desired
    phi = wrap_angle(np.pi - sample.bearing_current)
    return in_pixels(fundamental_from_bearings(Bearings(psi, phi)), camera.matrix, camera.matrix)


def view_size(image_size: tuple[int, int]) -> tuple[int, int]:
    """Return width and height [px] of the camera picture in the video; larger ones are shrunk."""
    # Encoders halve the colour planes, hence need even sizes; the map's width is even.
    return 2 * round(0.5 * HEIGHT * image_size[0] / image_size[1]), HEIGHT


class VideoWriter(AbstractContextManager['VideoWriter']):
    """
    Writer of an MP4 of H.264 by PyAV, a frame a control step; it appears when the run is complete.

    Use it as a context manager: if the block ends by an exception, or without a frame, there is no
    file. The run begins at ``start``. Raises InputError if it cannot be written, or the disk is
    full.
    """

    def __init__(self, path: Path, fps: float, *, start: Pose, camera: CameraModel) -> None:
        self.path, self._camera, self._av = path, camera, pyav()
        self._part = path.with_name(f'.{path.stem}.part{path.suffix}')
        self.size = view_size((camera.width, camera.height))[0] + WIDTH, HEIGHT
        self._map, self.frames = MapView(start, HEIGHT, field_of_view(camera)), 0
        if self._av is None:
            raise InputError(f'{path} needs PyAV; {WHAT_TO_INSTALL}')
        rate = Fraction(fps).limit_denominator(1000)
        self._time_base = 1 / rate
        with self._raise_input_errors():
            # The index comes first, so that a page can play what it has so far.
            self._container = self._av.open(str(self._part), 'w', options=FIRST)
            self._stream = self._container.add_stream('libx264', rate=rate, options=OPTIONS)
            self._stream.pix_fmt, (self._stream.width, self._stream.height) = 'yuv420p', self.size
            self._stream.codec_context.time_base = self._time_base
            self._container.start_encoding()

    def __exit__(self, kind: type[BaseException] | None, *_: object) -> None:
        container, self._container = self._container, None
        try:
            if container is not None:
                with self._raise_input_errors():
                    if self.frames:
                        container.mux(self._stream.encode())
                    container.close()
            if kind is None and self.frames:
                self._part.replace(self.path)
        finally:
            self._part.unlink(missing_ok=True)

    def add(self, image: Image, features: Features, sample: Sample) -> None:
        """Add one control step: what the camera saw, shape (H, W), its features, what was done."""
        self._map.add(sample)
        drawn = picture(image, features, sample, self._camera)
        frame = np.hstack([drawn, self._map.picture()])
        planes = cv2.cvtColor(frame, cv2.COLOR_BGR2YUV_I420)
        encoded = self._av.VideoFrame.from_ndarray(planes, format='yuv420p')
        encoded.pts, encoded.time_base = self.frames, self._time_base
        with self._raise_input_errors():
            self._container.mux(self._stream.encode(encoded))
        self.frames += 1

    @contextmanager
    def _raise_input_errors(self) -> Iterator[None]:
        try:
            yield
        except self._av.error.FFmpegError as error:
            self._container = None  # closed after a failure, some versions crash
            self._part.unlink(missing_ok=True)
            raise InputError(
                f'{self.path}: the video cannot be written: {error.strerror}; make room there, or '
                'leave the video out by --no-video'
            ) from None
