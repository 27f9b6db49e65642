"""Workers on this machine: one process a core, each with one thread."""

from collections.abc import Iterator
from concurrent.futures import Future, ProcessPoolExecutor
from concurrent.futures.process import BrokenProcessPool
from contextlib import contextmanager
from multiprocessing import active_children
from multiprocessing.connection import Connection
from multiprocessing.context import SpawnContext, SpawnProcess
import os
import threading

from visual_servo_epipolar.core.errors import VisualServoError
from visual_servo_epipolar.processes import ignore_interrupts, without_interrupts
from visual_servo_epipolar.sweeping.plan import Chunk, Result, SweepPlan, work

# Read when a process starts, or loads numpy and OpenCV: workers are started afresh for that.
THREADS = ('OMP_NUM_THREADS', 'OPENBLAS_NUM_THREADS', 'MKL_NUM_THREADS')
# The GNU allocator keeps what is freed. The pyramids of a first match, 20 MB a level, come as new
# pages otherwise, which takes a quarter of the match. Once set it no longer adapts, as
# ``closed_loop`` lets it where no worker has set it.
MEMORY = {'MALLOC_MMAP_THRESHOLD_': str(32 << 20), 'MALLOC_TRIM_THRESHOLD_': str(1 << 30)}
KEPT = 'finished runs are kept, and the same command goes on from there'


class LocalWorkers:
    """Processes of this machine; ``count`` of them."""

    def __init__(self, pool: ProcessPoolExecutor, count: int) -> None:
        self._pool, self.count = pool, count

    def submit(self, plan: SweepPlan, chunk: Chunk) -> 'Future[list[Result]]':
        """Have ``chunk`` done by one of them."""
        return self._pool.submit(work, plan, chunk)

    def check(self) -> None:
        """Leave it to the pool, which tells of a process that died by itself."""


@contextmanager
def local_workers(jobs: int) -> Iterator[LocalWorkers]:
    """Yield ``jobs`` worker processes, which end with the block, as those of ``worker_pool``."""
    with worker_pool(jobs, KEPT) as pool:
        yield LocalWorkers(pool, jobs)


@contextmanager
def worker_pool(jobs: int, remedy: str) -> Iterator[ProcessPoolExecutor]:
    """
    Yield a pool of ``jobs`` processes.

    They end with the block, and at once if it raises or if this process is killed.

    Raises VisualServoError if one of them dies; ``remedy`` says what to do about it.
    """
    spawn = _Spawn()
    lifeline, parent_end = spawn.Pipe(duplex=False)
    with _environment():
        pool = ProcessPoolExecutor(jobs, spawn, _live_by, (lifeline,))
        try:
            yield pool
        except BrokenProcessPool:
            raise VisualServoError(
                f'a worker process died (killed, or out of memory?); {remedy}'
            ) from None
        except BaseException:
            for process in active_children():  # some may not hear of ``lifeline`` yet
                if isinstance(process, _Worker):
                    process.kill()
            raise
        finally:
            pool.shutdown(cancel_futures=True)
            parent_end.close()
            lifeline.close()


class _Worker(SpawnProcess):
    """A new process that Ctrl-C does not end while it loads what it works with."""

    def start(self) -> None:
        """Start it; Ctrl-C is heard here when it has been started."""
        with without_interrupts(forked=False):
            super().start()


class _Spawn(SpawnContext):
    Process = _Worker


def _live_by(lifeline: Connection) -> None:
    """Leave Ctrl-C to the parent, and end when the other end of ``lifeline`` is gone."""
    ignore_interrupts()
    threading.Thread(target=_end_with, args=(lifeline,), daemon=True).start()


def _end_with(lifeline: Connection) -> None:
    try:
        lifeline.recv()
    except EOFError:
        os._exit(1)


@contextmanager
def _environment() -> Iterator[None]:
    """Let processes that are started meanwhile have one thread each, and keep their memory."""
    changes = {**dict.fromkeys(THREADS, '1'), **MEMORY}
    before = {name: os.environ.get(name) for name in changes}
    os.environ.update(changes)
    try:
        yield
    finally:
        for name, value in before.items():
            if value is None:
                del os.environ[name]
            else:
                os.environ[name] = value
