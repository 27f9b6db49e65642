"""Video of a run: the camera picture beside the live map, one frame a control step."""

from contextlib import AbstractContextManager
from pathlib import Path

import numpy as np

from visual_servo_epipolar.core.arrays import Image
from visual_servo_epipolar.core.cameras.model import CameraModel, field_of_view
from visual_servo_epipolar.core.servo.run_log import Sample
from visual_servo_epipolar.core.tracking.features import Features
from visual_servo_epipolar.report.images.encoders import open_encoder, WHAT_TO_INSTALL
from visual_servo_epipolar.report.images.map_view import MapBounds, MapView, WIDTH
from visual_servo_epipolar.report.images.picture import picture

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
