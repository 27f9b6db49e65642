"""Video of a run, written while it runs: the camera picture beside the live map."""

from pathlib import Path

import numpy as np

from visual_servo_epipolar.core.arrays import Image
from visual_servo_epipolar.core.servo.run_log import Sample
from visual_servo_epipolar.report.images.drawing import Resized
from visual_servo_epipolar.report.images.encoders import open_encoder, WHAT_TO_INSTALL
from visual_servo_epipolar.report.images.map_view import MapBounds, MapView, WIDTH
from visual_servo_epipolar.report.style import FIELD_OF_VIEW

HEIGHT = 720  # of the video [px]


def part_of(path: Path) -> Path:
    """Return where a video is written until it is complete."""
    return path.with_name(f'.{path.stem}.part{path.suffix}')


def view_size(image_size: tuple[int, int]) -> tuple[int, int]:
    """Return width and height [px] of the camera picture in the video; larger ones are shrunk."""
    # Encoders halve the colour planes, hence need even sizes; the map's width is even.
    return 2 * round(0.5 * HEIGHT * image_size[0] / image_size[1]), HEIGHT


class VideoWriter:
    """
    Writer of an MP4, one frame a control step; the file appears when the run is complete.

    Use it as a context manager: if the block ends by an exception, the unfinished file is removed.
    ``image_size`` is that of the overlay pictures to come, width and height [px]; the map shows
    ``bounds`` at first, and grows if the robot leaves it; it sees ``field_of_view`` [rad]. Raises
    InputError if no encoder here can write such a file there.
    """

    def __init__(
        self,
        path: Path,
        fps: float,
        *,
        image_size: tuple[int, int],
        bounds: MapBounds,
        field_of_view: float = FIELD_OF_VIEW,
    ) -> None:
        self.path, self._image_size = path, image_size
        self._view_width, _ = view = view_size(image_size)
        self._shown = Resized(image_size, view)
        self.size = self._view_width + WIDTH, HEIGHT
        self._map, self.frames = MapView(bounds, HEIGHT, field_of_view), 0
        self._part = part_of(path)
        self._encoder, self.codec = open_encoder(self._part, path, fps, self.size)

    def __enter__(self) -> 'VideoWriter':
        return self

    def __exit__(self, kind: type[BaseException] | None, *_: object) -> None:
        if kind is None:
            self.close()
        else:
            self.abort()

    @property
    def advice(self) -> str:
        """One line on what to install where no browser plays the video; empty where they do."""
        if self.codec.in_browsers:
            return ''
        return (
            f'{self.path.name} is for video players: browsers play no {self.codec.name}; for one '
            f'that they play, install PyAV ({WHAT_TO_INSTALL})'
        )

    def add(self, overlay: Image, sample: Sample) -> None:
        """
        Add one control step: what the camera saw, shape (H, W, 3), and what the servo did.

        Raises ValueError if the picture is not in colour or not of the size announced.
        """
        width, height = self._image_size
        if overlay.shape != (height, width, 3) or overlay.dtype != np.uint8:
            raise ValueError(
                f'overlay must be uint8 of shape ({height}, {width}, 3), got {overlay.dtype} of '
                f'shape {overlay.shape}; pass image_size as (width, height) of the overlays'
            )
        self._map.add(sample)
        frame = np.empty((HEIGHT, self.size[0], 3), dtype=np.uint8)
        frame[:, : self._view_width] = self._shown.image(overlay)
        frame[:, self._view_width :] = self._map.picture()
        self._encoder.write(frame)
        self.frames += 1

    def close(self) -> None:
        """Finish the file and give it its name; without a single frame there will be none."""
        self._encoder.close()
        if not self._part.exists():
            return
        if self.frames:
            self._part.replace(self.path)
        else:
            self._part.unlink()

    def abort(self) -> None:
        """Give up, and leave no file behind."""
        try:
            self._encoder.close()
        finally:
            self._part.unlink(missing_ok=True)
