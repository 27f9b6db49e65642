"""Work in order on a thread of its own, beside what makes it: drawing and encoding a video."""

from collections import deque
from collections.abc import Callable
from concurrent.futures import Future, ThreadPoolExecutor
from types import TracebackType
from typing import Any

WAITING = 8  # calls that may wait, each with an image


class Background:
    """
    Runs calls one after the other on one thread; OpenCV and encoders let go of Python meanwhile.

    Use it as a context manager: it ends when all calls have run, or, if the block ends by an
    exception, after the one that runs. What a call raises comes out of a later ``do``, or of the
    end of the block.
    """

    def __init__(self) -> None:
        self._pool = ThreadPoolExecutor(1, 'background')
        self._waiting: deque[Future[Any]] = deque()

    def __enter__(self) -> 'Background':
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        try:
            while kind is None and self._waiting:
                self._waiting.popleft().result()
        finally:
            self._pool.shutdown(cancel_futures=True)

    def do(self, call: Callable[..., Any], *arguments: Any) -> None:
        """Let ``call`` run after those before it; waits if too many do."""
        while self._waiting and (len(self._waiting) >= WAITING or self._waiting[0].done()):
            self._waiting.popleft().result()
        self._waiting.append(self._pool.submit(call, *arguments))
