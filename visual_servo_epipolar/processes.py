"""
Processes and threads: how many there are, and which of them Ctrl-C ends.

``python -m visual_servo_epipolar.processes PARENT MODULE [ARGUMENT ...]`` runs a module as
``python -m`` does, in a process that ends with the one of number PARENT, which started it.
"""

from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
import ctypes
from multiprocessing import resource_tracker
import os
import runpy
import signal
import sys

UNREAD, UNWRITTEN = 141, 2  # exit codes where the output is not read, or cannot be written
PR_SET_PDEATHSIG = 1
# Matrices here are small, and a library that shares their products waits for a core for each
# of them where others have the cores; the threads themselves keep a core busy by waiting.
ONE_THREAD = {'OPENBLAS_NUM_THREADS': '1'}


def one_thread() -> None:
    """Let numpy, which is not loaded yet, take one thread, unless the environment says more."""
    for name, value in ONE_THREAD.items():
        os.environ.setdefault(name, value)


def printing(name: str, run: Callable[[], int]) -> int:
    """Return the exit code of ``run``, or that its output cannot be written; silent if unread."""
    try:
        try:
            return run()
        finally:
            print(end='', flush=True)
    except OSError as error:
        # Print no more to it: the interpreter would complain about it at its end.
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        if isinstance(error, BrokenPipeError):
            return UNREAD
        with suppress(BrokenPipeError):
            print(f'{name}: output cannot be written: {error.strerror}', file=sys.stderr)
        return UNWRITTEN


def cores() -> int:
    """Return how many cores this process may use."""
    if hasattr(os, 'sched_getaffinity'):
        return len(os.sched_getaffinity(0))
    return os.cpu_count() or 1


def end_with(parent: int) -> bool:
    """
    Let this process be killed as soon as ``parent`` ends, however that comes; return if it lives.

    Linux means the thread of it that has started this process; elsewhere nothing is killed.
    """
    libc = ctypes.CDLL(None)
    if hasattr(libc, 'prctl'):
        libc.prctl(PR_SET_PDEATHSIG, signal.SIGKILL)
    return os.getppid() == parent


@contextmanager
def without_interrupts() -> Iterator[None]:
    """
    Hold SIGINT back, so that processes that are started meanwhile never end by it.

    Ctrl-C is sent to them as well, and where they are still loading they would die of it. Each
    calls ``ignore_interrupts`` then; this process gets what came when the block has ended.
    """
    resource_tracker.ensure_running()  # which lets SIGINT through when it starts by itself
    before = signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGINT})
    try:
        yield
    finally:
        signal.pthread_sigmask(signal.SIG_SETMASK, before)


def ignore_interrupts() -> None:
    """Leave Ctrl-C to the parent, as what this process starts will do unless it says otherwise."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    signal.pthread_sigmask(signal.SIG_UNBLOCK, {signal.SIGINT})


def main() -> None:
    """Run the module, unless the parent has ended meanwhile."""
    _, parent, *command = sys.argv
    if end_with(int(parent)):
        sys.argv[:] = command
        runpy.run_module(command[0], run_name='__main__', alter_sys=True)


if __name__ == '__main__':
    main()
