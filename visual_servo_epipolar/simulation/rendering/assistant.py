"""The image of an ideal pinhole, and a second process that draws a part of it on another core."""

from collections.abc import Callable, Iterator
from contextlib import AbstractContextManager, contextmanager
from functools import partial
from multiprocessing import parent_process
from multiprocessing.synchronize import Semaphore
import pickle
from time import perf_counter
from typing import Any

import cv2
import numpy as np

from visual_servo_epipolar.core.arrays import Image
from visual_servo_epipolar.processes import begun, context, is_forked
from visual_servo_epipolar.simulation.rendering.edges import mixing, smooth_edges
from visual_servo_epipolar.simulation.rendering.raster import PinholeView, Raster, rasterize
from visual_servo_epipolar.simulation.rendering.sampling import draw_textures
from visual_servo_epipolar.simulation.rendering.strips import Strip
from visual_servo_epipolar.simulation.rendering.surfaces import Scene

MAIN, ASSISTANT = 0, 1
STRIP = 10_000  # samples that take as long as a strip takes besides
UNEVEN = 0.04  # of all work: by how much one may have more, for a strip to stay where it is

Numbers = tuple[frozenset[int], frozenset[int]]
SPARED, MOST_SPARED = 0.06, 0.5  # of the work, that the main process has less
GAIN = 0.1  # of what was uneven in one image that is mended in the next
MOST_UNEVEN = 0.3  # that counts: whoever makes copies of textures is late this once
LOOK_S = 1.0  # time between looks whether the other process lives
END_S = 10.0  # for the process to end
REQUEST = 4096  # room for what it is asked [byte]


class Sharing:
    """
    Shares of two processes; where both are asked for the same rasters, they give the same answers.

    A strip mostly stays with one process, which has its texels in its cache.
    """

    def __init__(self) -> None:
        self._owners: dict[Strip, int] = {}

    def shares(self, raster: Raster, spared: float) -> Numbers:
        """
        Return the numbers of the strips, from 1, that main process and assistant draw.

        The main process gets less by ``spared``, of all work.
        """
        costs = [
            STRIP + (right - left) * (bottom - top) * strip.columns * strip.rows
            for strip, (left, top, right, bottom) in zip(raster.strips, raster.boxes, strict=True)
        ]
        total = sum(costs)
        work = [max(spared, 0.0) * total, max(-spared, 0.0) * total]
        most = 0.5 * (sum(work) + (1.0 + UNEVEN) * total)
        numbers: tuple[list[int], list[int]] = [], []
        owners: dict[Strip, int] = {}
        for number in sorted(range(len(costs)), key=lambda it: (-costs[it], it)):
            strip, least = raster.strips[number], work.index(min(work))
            owner = self._owners.get(strip, least)
            if work[owner] + costs[number] > most:
                owner = least
            owners[strip] = owner
            work[owner] += costs[number]
            numbers[owner].append(number + 1)
        self._owners = owners
        return frozenset(numbers[MAIN]), frozenset(numbers[ASSISTANT])


class Assistant(AbstractContextManager['Assistant']):
    """
    A process that draws its share of the strips of each view of the scene that ``build`` makes.

    ``build`` must be picklable, and make the scene that is drawn here. Whether it helps changes no
    bit of an image: it helps as soon as it has made its scene, and where it dies it is done
    without, as for views of more than ``pixels``. A thread would do the same, were it not for all
    the Python in between.
    """

    def __init__(self, build: Callable[[], Scene], pixels: int) -> None:
        with one_thread_of_opencv():
            beside = context()
            if is_forked(beside):  # with a scene that is made once for both
                build = partial(_same, build())
            # A pipe would wake the process on this core, where there is work to go on with.
            self._asked, self._drawn = beside.Semaphore(0), beside.Semaphore(0)
            self._drawn_s: Any = beside.Value('d', lock=False)  # when it was ready
            # Unlike named memory it is gone with both processes, however they end.
            self._request: Any = beside.RawArray('B', REQUEST)
            self._pixels: Any = beside.RawArray('B', pixels)
            given = self._request, self._asked, self._drawn, self._drawn_s, self._pixels, build
            self._process = begun(beside, 'assistant', _assist, given)
        self._ready = self._lost = self._asks = False
        self._sharing, self._spared, self._begun_s = Sharing(), SPARED, 0.0

    def __exit__(self, *_: object) -> None:
        self._ask(None)
        self._process.join(END_S)
        self._process.kill()

    def wait(self) -> bool:
        """Wait until it has made its scene; return False if it has died instead."""
        self._ready = self._ready or self._await_sign()
        return self._ready

    def begin(self, view: PinholeView) -> bool:
        """Let the process draw its share of ``view``; return whether it does."""
        # Of a view that was never finished, what comes next would be taken for this one's.
        self._lost = self._lost or self._asks
        if self._lost or view.width * view.height > len(self._pixels):
            return False
        self._ready = self._ready or self._drawn.acquire(block=False)
        if not self._ready:
            return False
        if not self._process.is_alive():
            self._lost = True
            return False
        self._asks, self._begun_s = True, perf_counter()
        self._ask((view, self._spared))
        return True

    def shares(self, raster: Raster) -> Numbers:
        """Return the numbers of the strips drawn here and there; once for each view begun."""
        return self._sharing.shares(raster, self._spared)

    def finish(self, image: Image) -> bool:
        """Add its share to ``image``, black there; return whether there is one: it may be dead."""
        ready_s, self._asks = perf_counter(), False
        if not self._await_sign():
            self._lost = True
            return False
        late = (self._drawn_s.value - ready_s) / (ready_s - self._begun_s)
        spared = self._spared - GAIN * min(max(late, -MOST_UNEVEN), MOST_UNEVEN)
        self._spared = min(max(spared, -MOST_SPARED), MOST_SPARED)
        cv2.bitwise_or(image, _image(self._pixels, image.shape), dst=image)
        return True

    def _ask(self, what: tuple[PinholeView, float] | None) -> None:
        """Hand over ``what`` there is to draw, or None to end it."""
        # As a whole: the order of a matrix in memory decides on the last bits of its products.
        message = pickle.dumps(what)
        memoryview(self._request).cast('B')[: len(message)] = message
        self._asked.release()

    def _await_sign(self) -> bool:
        """Wait for a sign of the process; return False if it has died."""
        while not self._drawn.acquire(timeout=LOOK_S):
            if not self._process.is_alive():
                return False
        return True


def _assist(
    request: Any,
    asked: Semaphore,
    drawn: Semaphore,
    drawn_s: Any,
    pixels: Any,
    build: Callable[[], Scene],
) -> None:
    """Draw what is asked for, until that is nothing or nobody is there to ask."""
    cv2.setNumThreads(1)
    scene, sharing = build(), Sharing()
    drawn.release()
    while _is_asked(asked):
        what = pickle.loads(request)
        if what is None:
            return
        view, spared = what
        seen = scene.seen_from(view.centre)
        raster = rasterize(seen, view)
        image = _image(pixels, (view.height, view.width))
        image[:] = 0
        draw_textures(seen, raster, image, sharing.shares(raster, spared)[ASSISTANT])
        drawn_s.value = perf_counter()
        drawn.release()


@contextmanager
def one_thread_of_opencv() -> Iterator[None]:
    """End the threads of OpenCV, which a fork would miss; where they are needed it starts them."""
    threads = cv2.getNumThreads()
    cv2.setNumThreads(1)
    try:
        yield
    finally:
        cv2.setNumThreads(threads)


def _same(scene: Scene) -> Scene:
    return scene


def _image(pixels: Any, shape: tuple[int, ...]) -> Image:
    """Return the image in shared memory."""
    return np.frombuffer(pixels, np.uint8, shape[0] * shape[1]).reshape(shape)


def _is_asked(asked: Semaphore) -> bool:
    """Wait to be asked; return False if the parent has died."""
    while not asked.acquire(timeout=LOOK_S):
        parent = parent_process()
        if parent is None or not parent.is_alive():
            return False
    return True


def draw(scene: Scene, view: PinholeView, assistant: Assistant | None = None) -> Image:
    """Return the image of ``scene``, shape (H, W), the same to the last bit with an assistant."""
    scene = scene.seen_from(view.centre)
    if assistant is not None and not assistant.begin(view):
        assistant = None
    raster = rasterize(scene, view)
    edges = mixing(scene, view, raster)  # first, while the raster is in the cache
    image: Image = np.zeros((view.height, view.width), dtype=np.uint8)
    if assistant is None:
        draw_textures(scene, raster, image)
    else:
        numbers = assistant.shares(raster)
        draw_textures(scene, raster, image, numbers[MAIN])
        if not assistant.finish(image):
            draw_textures(scene, raster, image, numbers[ASSISTANT])
    smooth_edges(image, edges)
    return image
