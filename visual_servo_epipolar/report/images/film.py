"""Video of a run: the camera picture beside the live map; drawn by a process beside the run."""

from contextlib import AbstractContextManager, suppress
import fcntl
from multiprocessing.connection import Connection
from multiprocessing.synchronize import Semaphore
from pathlib import Path
from typing import Any

import cv2
import numpy as np

from visual_servo_epipolar.core.arrays import Image
from visual_servo_epipolar.core.cameras.model import CameraModel, field_of_view
from visual_servo_epipolar.core.errors import VisualServoError
from visual_servo_epipolar.core.servo.run_log import Sample
from visual_servo_epipolar.core.tracking.features import Features
from visual_servo_epipolar.processes import begun, context, hurry, work_beside
from visual_servo_epipolar.report.images.encoders import open_encoder, WHAT_TO_INSTALL
from visual_servo_epipolar.report.images.map_view import MapBounds, MapView, WIDTH
from visual_servo_epipolar.report.images.picture import picture
from visual_servo_epipolar.report.style import FIELD_OF_VIEW

HEIGHT = 720  # of the video [px]
# Images that may wait: where a run is faster than its film, the film catches up at the end.
WAITING_BYTES, LEAST_WAITING, MOST_WAITING = 1 << 27, 8, 256
PIPE_BYTES = 1 << 20  # of what belongs to images that wait
LOOK_S = 0.5  # time between looks whether the process lives
END_S = 60.0  # for the encoder to write what it holds


def part_of(path: Path) -> Path:
    """Return where a video is written until it is complete."""
    return path.with_name(f'.{path.stem}.part{path.suffix}')


def view_size(image_size: tuple[int, int]) -> tuple[int, int]:
    """Return width and height [px] of the camera picture in the video; larger ones are shrunk."""
    # Encoders halve the colour planes, hence need even sizes; the map's width is even.
    return 2 * round(0.5 * HEIGHT * image_size[0] / image_size[1]), HEIGHT


class VideoWriter(AbstractContextManager['VideoWriter']):
    """
    Writer of an MP4, one frame a control step; the file appears when the run is complete.

    Use it as a context manager: if the block ends by an exception, or without a frame, there is no
    file. ``width`` is that of the pictures to come, as ``view_size`` has it; the map shows
    ``bounds`` at first, and grows if the robot leaves it; it sees ``field_of_view`` [rad]. Raises
    InputError if no encoder here can write such a file there.
    """

    def __init__(
        self,
        path: Path,
        fps: float,
        *,
        width: int,
        bounds: MapBounds,
        field_of_view: float = FIELD_OF_VIEW,
    ) -> None:
        self.path, self._part = path, part_of(path)
        self.size = width + WIDTH, HEIGHT
        self._map, self.frames = MapView(bounds, HEIGHT, field_of_view), 0
        self._encoder, self.codec = open_encoder(self._part, path, fps, self.size)

    def __exit__(self, kind: type[BaseException] | None, *_: object) -> None:
        try:
            self._encoder.close()
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

    def add(self, overlay: Image, sample: Sample) -> None:
        """Add one control step: what the camera saw, shape (HEIGHT, width, 3), what was done."""
        self._map.add(sample)
        self._encoder.write(np.hstack([overlay, self._map.picture()]))
        self.frames += 1


class Film(AbstractContextManager['Film']):
    """
    Writer of the video ``path``, one frame a control step, which draws and encodes beside the run.

    A thread would do the same, but each of its hundreds of calls into OpenCV takes Python away
    from the run, for up to 5 ms; images pass by shared memory for the same reason. The file
    appears at the end of the ``with`` block; if that ends by an exception, or this process dies,
    there is none. Any call raises InputError if no encoder here can write such a file there, or
    the disk is full, and VisualServoError if the process has died.
    """

    def __init__(self, path: Path, fps: float, *, bounds: MapBounds, camera: CameraModel) -> None:
        self._path, self._camera = path, camera
        beside = context()
        there, self._here = beside.Pipe()
        steps, self._steps = beside.Pipe(duplex=False)
        with suppress(OSError):  # of a user who has many large pipes: then steps wait here
            fcntl.fcntl(self._steps.fileno(), fcntl.F_SETPIPE_SZ, PIPE_BYTES)
        size = camera.width * camera.height
        self._waiting = min(max(WAITING_BYTES // size, LEAST_WAITING), MOST_WAITING)
        # Unlike named memory it is gone with both processes, however they end.
        self._pixels: Any = beside.RawArray('B', self._waiting * size)
        self._free = beside.Semaphore(self._waiting)
        given = there, steps, self._pixels, self._free, path, fps, bounds, camera
        self._process = begun(beside, 'film', _draw, given, ours=(self._here, self._steps))
        there.close()
        steps.close()
        self._count, self._ended = 0, False
        self._advice: str | None = None

    @property
    def advice(self) -> str:
        """What to install where no browser plays the video; waits until the file is open."""
        if self._advice is None:
            self._advice = self._answer()
        return self._advice

    def add(self, image: Image, features: Features, sample: Sample) -> None:
        """
        Add one control step: what the camera saw, shape (H, W), its features, what the servo did.

        Raises ValueError if the image has not the size of the camera.
        """
        camera = self._camera
        if image.shape != (camera.height, camera.width):
            raise ValueError(
                f'images must have {camera.width}x{camera.height} px as the camera has, got '
                f'{image.shape[1]}x{image.shape[0]}; check width and height of the CameraInfo'
            )
        while not self._free.acquire(timeout=LOOK_S):
            if not self._process.is_alive():
                self._answer()
        _images(self._pixels, camera)[self._count % self._waiting] = image
        self._send((features, sample))
        self._count += 1

    def end(self) -> None:
        """Tell that there are no more steps; returns at once, the ``with`` block waits."""
        if not self._ended:
            self._ended = True
            self._send(None)
            hurry(self._process.pid)

    def __exit__(self, kind: type[BaseException] | None, *_: object) -> None:
        try:
            if kind is None:
                self._complete()
        finally:
            self._steps.close()  # which ends it
            self._here.close()
            if kind is not None:  # an idle process may take its time
                self._process.kill()
            self._process.join(END_S)
            self._process.kill()
            part_of(self._path).unlink(missing_ok=True)

    def _complete(self) -> None:
        self.end()
        if not self._here.poll(END_S):
            raise VisualServoError(f'the video is not finished after {END_S:g} s; run again')
        self._answer()

    def _send(self, step: tuple[Features, Sample] | None) -> None:
        """Tell the process of a step, or of the end; raise what it has raised meanwhile."""
        _ = self.advice
        try:
            if self._here.poll():
                self._answer()
            self._steps.send(step)
        except OSError:
            self._answer()
            raise

    def _answer(self) -> str:
        """Return what the process says, or raise what it has raised."""
        try:
            answer = self._here.recv()
        except (EOFError, OSError):
            raise VisualServoError(
                'the process that draws the video died (killed, or out of memory?); run again, '
                'or leave the video out by --no-video'
            ) from None
        if isinstance(answer, Exception):
            raise answer
        return str(answer)


def _images(pixels: Any, camera: CameraModel) -> Image:
    return np.frombuffer(pixels, np.uint8).reshape(-1, camera.height, camera.width)


def _draw(
    there: Connection,
    steps: Connection,
    pixels: Any,
    free: Semaphore,
    path: Path,
    fps: float,
    bounds: MapBounds,
    camera: CameraModel,
) -> None:
    """Write the video of the steps that come; an end without a word means that there is none."""
    # The run goes first, at once: each step of it waits for all before, the film for none.
    work_beside()
    cv2.setNumThreads(1)
    size, images = view_size((camera.width, camera.height)), _images(pixels, camera)
    try:
        angle = field_of_view(camera)
        with VideoWriter(path, fps, width=size[0], bounds=bounds, field_of_view=angle) as video:
            there.send(video.advice)
            while (step := steps.recv()) is not None:
                features, sample = step
                drawn = picture(images[video.frames % len(images)], features, sample, camera, size)
                free.release()
                video.add(drawn, sample)
        there.send('')
    except (EOFError, BrokenPipeError):  # the parent's end is closed
        pass
    except (VisualServoError, ValueError, OSError) as error:
        there.send(error)
