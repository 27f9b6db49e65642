"""Film of a run while it runs: drawn and encoded by a process of its own."""

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from multiprocessing import get_context
from multiprocessing.connection import Connection
from multiprocessing.synchronize import Semaphore
import os
from pathlib import Path
import signal
from typing import Any

import cv2
import numpy as np

from visual_servo_epipolar.core.arrays import Image
from visual_servo_epipolar.core.errors import VisualServoError
from visual_servo_epipolar.core.geometry.cameras.model import CameraModel
from visual_servo_epipolar.core.servo.run_log import Sample
from visual_servo_epipolar.core.tracking.features import Features
from visual_servo_epipolar.report.images.map_view import Bounds
from visual_servo_epipolar.report.images.picture import picture
from visual_servo_epipolar.report.images.video import part_of, VideoWriter, view_size

WAITING = 8  # images that may wait
LOOK_S = 0.5  # time between looks whether the process lives
END_S = 60.0  # for the encoder to write what it holds

Add = Callable[[Image, Features, Sample], None]


@contextmanager
def filmed(
    path: Path, fps: float, *, bounds: Bounds, camera: CameraModel
) -> Iterator[tuple[Add, str]]:
    """
    Give what adds a control step to the video ``path``, and the writer's advice on players.

    A thread would do the same, but each of its hundreds of calls into OpenCV takes Python away
    from the run, for up to 5 ms; images pass by shared memory for the same reason. The file
    appears at the end of the block; if that ends by an exception, or this process dies, there is
    none.

    Raises
    ------
    InputError
        If no encoder here can write such a file there, or the disk is full.
    ValueError
        If an image has not the size of the camera.
    VisualServoError
        If the process dies.

    """
    spawn = get_context('spawn')
    there, here = spawn.Pipe()
    # Unlike named memory it is gone with both processes, however they end.
    pixels: Any = spawn.RawArray('B', WAITING * camera.width * camera.height)
    free = spawn.Semaphore(WAITING)
    given = there, pixels, free, path, fps, bounds, camera
    process = spawn.Process(target=_draw, args=given, name='film', daemon=True)
    process.start()
    there.close()
    count = 0

    def add(image: Image, features: Features, sample: Sample) -> None:
        nonlocal count
        if image.shape != (camera.height, camera.width):
            raise ValueError(
                f'images must have {camera.width}x{camera.height} px as the camera has, got '
                f'{image.shape[1]}x{image.shape[0]}; check width and height of the CameraInfo'
            )
        while not free.acquire(timeout=LOOK_S):
            if not process.is_alive():
                _answer(here)
        _images(pixels, camera)[count % WAITING] = image
        _send(here, (features, sample))
        count += 1

    try:
        yield add, _answer(here)
        _send(here, None)
        if not here.poll(END_S):
            raise VisualServoError(f'the video is not finished after {END_S:g} s; run again')
        _answer(here)
    finally:
        here.close()  # which ends it, with an unfinished file or without
        process.join(END_S)
        process.kill()
        part_of(path).unlink(missing_ok=True)


def _images(pixels: Any, camera: CameraModel) -> Image:
    """Return the images that wait, shape (WAITING, H, W)."""
    return np.frombuffer(pixels, np.uint8).reshape(WAITING, camera.height, camera.width)


def _send(here: Connection, step: tuple[Features, Sample] | None) -> None:
    """Tell the process of a step, or of the end; raise what it has raised meanwhile."""
    try:
        if here.poll():
            _answer(here)
        here.send(step)
    except OSError:
        _answer(here)
        raise


def _answer(here: Connection) -> str:
    """Return what the process says, or raise what it has raised."""
    try:
        answer = here.recv()
    except (EOFError, OSError):
        raise VisualServoError(
            'the process that draws the video died (killed, or out of memory?); run again, or '
            'leave the video out by --no-video'
        ) from None
    if isinstance(answer, Exception):
        raise answer
    return str(answer)


def _draw(
    there: Connection,
    pixels: Any,
    free: Semaphore,
    path: Path,
    fps: float,
    bounds: Bounds,
    camera: CameraModel,
) -> None:
    """Write the video of the steps that come; an end without a word means that there is none."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # Ctrl-C is the parent's
    # The run goes first, at once: each step of it waits for all before, the film for none.
    os.sched_setscheduler(0, os.SCHED_IDLE, os.sched_param(0))
    cv2.setNumThreads(1)
    size = view_size((camera.width, camera.height))
    try:
        with VideoWriter(path, fps, image_size=size, bounds=bounds) as video:
            there.send(video.advice)
            while (step := there.recv()) is not None:
                features, sample = step
                image = _images(pixels, camera)[video.frames % WAITING]
                drawn = picture(image, features, sample, camera, size)
                free.release()
                video.add(drawn, sample)
        there.send('')
    except (EOFError, BrokenPipeError):  # the parent's end is closed
        pass
    except (VisualServoError, ValueError, OSError) as error:
        there.send(error)
