"""Workers: processes of this machine, one a core with one thread, or those of a Dask cluster."""

import asyncio
from collections.abc import Callable, Iterator
from concurrent.futures import CancelledError, Future, ProcessPoolExecutor
from concurrent.futures.process import BrokenProcessPool
from contextlib import contextmanager
import logging
from multiprocessing import active_children
from multiprocessing.context import SpawnContext, SpawnProcess
import os
import pickle
from typing import Any

from visual_servo_epipolar.core.errors import InputError, VisualServoError
from visual_servo_epipolar.processes import end_with, ignore_interrupts, without_interrupts
from visual_servo_epipolar.sweeping.plan import Chunk, Result, SweepPlan, work
from visual_servo_epipolar.sweeping.provenance import digest

# Read when a process starts, or loads numpy and OpenCV: workers are started afresh for that.
THREADS = ('OMP_NUM_THREADS', 'OPENBLAS_NUM_THREADS', 'MKL_NUM_THREADS')
# The GNU allocator keeps what is freed. The pyramids of a first match, 20 MB a level, come as new
# pages otherwise, which takes a quarter of the match.
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
    with _environment():
        pool = ProcessPoolExecutor(jobs, _Spawn(), _begin, (os.getpid(),))
        try:
            yield pool
        except BrokenProcessPool:
            raise VisualServoError(
                f'a worker process died (killed, or out of memory?); {remedy}'
            ) from None
        except BaseException:
            for process in active_children():
                if isinstance(process, _Worker):
                    process.kill()
            raise
        finally:
            pool.shutdown(cancel_futures=True)


class _Worker(SpawnProcess):
    """A new process that Ctrl-C does not end while it loads what it works with."""

    def start(self) -> None:
        """Start it; Ctrl-C is heard here when it has been started."""
        with without_interrupts():
            super().start()


class _Spawn(SpawnContext):
    Process = _Worker


def _begin(parent: int) -> None:
    """Leave Ctrl-C to the parent, and end when it does."""
    ignore_interrupts()
    if not end_with(parent):
        os._exit(1)


@contextmanager
def _environment() -> Iterator[None]:
    """Let processes that are started meanwhile have one thread each, and keep their memory."""
    before = dict(os.environ)
    os.environ.update({**dict.fromkeys(THREADS, '1'), **MEMORY})
    try:
        yield
    finally:
        os.environ.clear()
        os.environ.update(before)


CONNECT_S = 10.0  # for a scheduler to answer


class ClusterWorkers:
    """Threads of the workers of a cluster; ``count`` of them when the sweep begins."""

    def __init__(self, client: Any) -> None:
        self.count = sum(client.nthreads().values())
        self._client = client
        self._executor = client.get_executor(pure=False)
        self._call = _by_value()

    def submit(self, plan: SweepPlan, chunk: Chunk) -> 'Future[list[Result]]':
        """Have ``chunk`` done by one of them."""
        # As bytes: the scheduler looks into what it hands on, and need not have this package.
        future: Future[list[Result]] = self._executor.submit(
            self._call, pickle.dumps((work_here, digest(), plan, chunk))
        )
        return future

    def check(self) -> None:
        """Raise VisualServoError if the cluster has no workers left."""
        if not self._client.nthreads():
            raise VisualServoError(f'the cluster has lost all its workers; {KEPT}')


def work_here(code: str, plan: SweepPlan, chunk: Chunk) -> list[Result]:
    """Do ``chunk`` on a worker, however late it joined; InputError if its code is not ours."""
    if digest() != code:
        raise InputError(
            f'a Dask worker runs different code of visual_servo_epipolar ({digest()} there, '
            f'{code} here); install this version of it there and restart the worker'
        )
    return work(plan, chunk)


@contextmanager
def cluster_workers(address: str) -> Iterator[ClusterWorkers]:
    """
    Yield the workers of the cluster whose scheduler is at ``address``.

    Raises InputError if no scheduler answers, there are no workers, or they lack this package or
    this version of it; VisualServoError if they are lost on the way.
    """
    client = _client(address)
    try:
        yield ClusterWorkers(client)
    except ModuleNotFoundError as error:
        raise InputError(
            f'a Dask worker cannot import visual_servo_epipolar ({error}); install this version '
            'of it there'
        ) from None
    except _losses() as error:
        raise VisualServoError(
            f'the cluster at {address} was lost ({_first_line(error)}); {KEPT}'
        ) from None
    finally:
        client.close()


def _client(address: str) -> Any:
    from distributed import Client
    from distributed.comm import resolve_address

    logging.getLogger('distributed').setLevel(logging.CRITICAL)  # one line here reports it
    try:
        resolve_address(address)
        client = Client(address, timeout=CONNECT_S, set_as_default=False)
    except (OSError, ValueError) as error:
        raise InputError(
            f'no Dask scheduler answers at {address!r} ({_first_line(error)}); start one with '
            '"dask scheduler", and give the address that it prints'
        ) from None
    try:
        client.wait_for_workers(1, timeout=CONNECT_S)
    except asyncio.TimeoutError:  # not yet the builtin one in Python 3.10
        client.close()
        raise InputError(
            f'the Dask scheduler at {address} has no workers; start some with '
            f'"dask worker {address}"'
        ) from None
    return client


def _by_value() -> Callable[[bytes], Any]:
    """Return a function that is pickled with its code, as it is nowhere to be imported from."""

    def call(payload: bytes) -> Any:
        import pickle

        function, *arguments = pickle.loads(payload)
        return function(*arguments)

    return call


def _losses() -> tuple[type[BaseException], ...]:
    from distributed import KilledWorker
    from distributed.comm import CommClosedError

    return KilledWorker, CommClosedError, CancelledError


def _first_line(error: BaseException) -> str:
    return (str(error).splitlines() or [type(error).__name__])[0]


Workers = LocalWorkers | ClusterWorkers
