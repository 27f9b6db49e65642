"""Work in order on a thread of its own, beside what makes it: drawing and encoding a video."""

from collections import deque
from collections.abc import Callable, Iterator
from concurrent.futures import Future, ThreadPoolExecutor
from contextlib import contextmanager
from typing import Any

WAITING = 8  # calls that may wait, each with an image


@contextmanager
def background() -> Iterator[Callable[..., None]]:
    """
    Give what runs calls one after the other on one thread, as ``do(call, *arguments)``.

    OpenCV and encoders let go of Python meanwhile; ``do`` waits if too many calls do. The block
    ends when all have run, or, if it ends by an exception, after the one that runs. What a call
    raises comes out of a later ``do``, or of the end of the block.
    """
    waiting: deque[Future[Any]] = deque()
    pool = ThreadPoolExecutor(1, 'background')

    def do(call: Callable[..., Any], *arguments: Any) -> None:
        while waiting and (len(waiting) >= WAITING or waiting[0].done()):
            waiting.popleft().result()
        waiting.append(pool.submit(call, *arguments))

    try:
        yield do
        while waiting:
            waiting.popleft().result()
    finally:
        pool.shutdown(cancel_futures=True)
