"""A second process that draws a part of each image, on another core."""

from collections.abc import Callable
from contextlib import AbstractContextManager
from multiprocessing import get_context, parent_process
from multiprocessing.connection import Connection
from multiprocessing.shared_memory import SharedMemory
from multiprocessing.synchronize import Semaphore
import signal
from time import perf_counter
from typing import Any

import cv2
import numpy as np

from visual_servo_epipolar.core.arrays import Image
from visual_servo_epipolar.simulation.rendering.raster import Raster, rasterize, View
from visual_servo_epipolar.simulation.rendering.sampling import textured
from visual_servo_epipolar.simulation.rendering.sharing import ASSISTANT, Numbers, Sharing
from visual_servo_epipolar.simulation.rendering.surfaces import Scene

SPARED, MOST_SPARED = 0.06, 0.5  # of the work, that the main process has less
GAIN = 0.25  # of what was uneven in one image that is mended in the next
LOOK_S = 1.0  # time between looks whether the other process lives
END_S = 10.0  # for the process to end


class Assistant(AbstractContextManager['Assistant']):
    """
    A process that draws its share of the strips of each view of the scene that ``build`` makes.

    ``build`` must be picklable, and make the scene that is drawn here. Whether it helps changes no
    bit of an image: it helps as soon as it has made its scene, and where it dies it is done
    without. A thread would do the same, were it not for all the Python in between.
    """

    def __init__(self, build: Callable[[], Scene]) -> None:
        spawn = get_context('spawn')
        there, self._here = spawn.Pipe()
        # A pipe would wake the process on this core, where there is work to go on with.
        self._asked, self._drawn = spawn.Semaphore(0), spawn.Semaphore(0)
        self._drawn_s: Any = spawn.Value('d', lock=False)  # when it was ready
        given = there, self._asked, self._drawn, self._drawn_s, build
        self._process = spawn.Process(target=_assist, args=given, name='assistant', daemon=True)
        self._process.start()
        there.close()
        self._ready, self._memory = False, _Memory()
        self._sharing, self._spared, self._begun_s = Sharing(), SPARED, 0.0

    def __exit__(self, *_: object) -> None:
        self._here.close()
        self._asked.release()  # what it is asked then is nothing, which ends it
        self._process.join(END_S)
        self._process.kill()
        self._memory.close()

    def wait(self) -> bool:
        """Wait until it has made its scene; return False if it has died instead."""
        self._ready = self._ready or self._awaited()
        return self._ready

    def begin(self, view: View) -> bool:
        """Let the process draw its share of ``view``; return whether it does."""
        self._ready = self._ready or self._drawn.acquire(block=False)
        if not self._ready:
            return False
        try:
            name = self._memory.of(view.width * view.height)
            self._here.send((name, view, self._spared))
        except OSError:
            return self._lost()
        self._begun_s = perf_counter()
        self._asked.release()
        return True

    def shares(self, raster: Raster) -> Numbers:
        """Return the numbers of the strips drawn here and there; once for each view begun."""
        return self._sharing.shares(raster, self._spared)

    def finish(self, image: Image) -> bool:
        """Add its share to ``image``, black there; return whether there is one: it may be dead."""
        ready_s = perf_counter()
        if not self._awaited():
            return self._lost()
        late = (self._drawn_s.value - ready_s) / (ready_s - self._begun_s)
        spared = self._spared - GAIN * min(max(late, -1.0), 1.0)
        self._spared = min(max(spared, -MOST_SPARED), MOST_SPARED)
        cv2.bitwise_or(image, self._memory.image(image.shape), dst=image)
        return True

    def _awaited(self) -> bool:
        """Wait for a sign of the process; return False if it has died."""
        while not self._drawn.acquire(timeout=LOOK_S):
            if not self._process.is_alive():
                return False
        return True

    def _lost(self) -> bool:
        self._ready = False
        return False


class _Memory:
    """Memory shared by both processes, as much as the largest image so far needed."""

    def __init__(self) -> None:
        self._shared: SharedMemory | None = None

    def of(self, size: int) -> str:
        """Return the name of memory of at least ``size`` bytes."""
        if self._shared is None or self._shared.size < size:
            self.close()
            self._shared = SharedMemory(create=True, size=size)
        return self._shared.name

    def image(self, shape: tuple[int, ...]) -> Image:
        """Return what the process has drawn."""
        assert self._shared is not None
        return np.ndarray(shape, np.uint8, self._shared.buf)

    def close(self) -> None:
        """Give the memory back."""
        if self._shared is not None:
            self._shared.close()
            self._shared.unlink()


def _assist(
    there: Connection,
    asked: Semaphore,
    drawn: Semaphore,
    drawn_s: Any,
    build: Callable[[], Scene],
) -> None:
    """Draw what is asked for, until the other end is closed."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # Ctrl-C is the parent's
    cv2.setNumThreads(1)
    scene, sharing = build(), Sharing()
    memory: SharedMemory | None = None
    drawn.release()
    while _is_asked(asked):
        try:
            name, view, spared = there.recv()
        except (EOFError, OSError):
            return
        if memory is None or memory.name != name:
            memory = SharedMemory(name)
        raster = rasterize(scene, view)
        shape = view.height, view.width
        image: Image = np.ndarray(shape, np.uint8, memory.buf)
        image[:] = 0
        textured(scene, raster, image, sharing.shares(raster, spared)[ASSISTANT])
        del image  # or the memory could not be closed
        drawn_s.value = perf_counter()
        drawn.release()


def _is_asked(asked: Semaphore) -> bool:
    """Wait to be asked; return False if the parent has died."""
    while not asked.acquire(timeout=LOOK_S):
        parent = parent_process()
        if parent is None or not parent.is_alive():
            return False
    return True
