"""
Processes beside this one: copies of it where that is safe, otherwise new ones.

``python -m visual_servo_epipolar.processes PARENT MODULE [ARGUMENT ...]`` runs a module as by
``python -m``, in a process that ends with the one of number PARENT, which started it.
"""

from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager, suppress
import ctypes
from multiprocessing import get_context, resource_tracker
from multiprocessing.connection import Connection
import os
from pathlib import Path
import runpy
import signal
import sys
from threading import current_thread, main_thread
from typing import Any

THREADS = Path('/proc/self/task')  # of Linux
PR_SET_PDEATHSIG = 1


def cores() -> int:
    """Return how many cores this process may use."""
    if hasattr(os, 'sched_getaffinity'):
        return len(os.sched_getaffinity(0))
    return os.cpu_count() or 1


def may_fork() -> bool:
    """Return whether this process has one thread: what others lock stays locked in a copy."""
    return THREADS.is_dir() and len(list(THREADS.iterdir())) == 1


def context() -> Any:
    """
    Return multiprocessing's context of processes that are started now.

    A fork has all that is loaded here, for which a new process takes up to a second.
    """
    return get_context('fork' if may_fork() else 'spawn')


def is_forked(beside: Any) -> bool:
    """Return whether processes of the context ``beside`` have what is loaded here."""
    return bool(beside.get_start_method() == 'fork')


def end_with(parent: int) -> bool:
    """
    Let this process be killed as soon as ``parent`` ends, however that comes; return if it lives.

    Linux means the thread of it that has started this process; elsewhere nothing is killed.
    """
    libc = ctypes.CDLL(None)
    if hasattr(libc, 'prctl'):
        libc.prctl(PR_SET_PDEATHSIG, signal.SIGKILL)
    return os.getppid() == parent


def copied(work: Callable[[], object]) -> Callable[[], bool]:
    """
    Begin ``work`` in a copy of this process, which may fork; return what waits for its end.

    That returns whether the work was done. The copy ends with this process at the latest, which
    may be one of multiprocessing itself: those make no others.
    """
    parent = os.getpid()
    try:
        pid = os.fork()
    except OSError:  # too many processes, or too little memory
        return lambda: False
    if pid:
        return lambda: os.waitpid(pid, 0)[1] == 0
    try:
        if end_with(parent):
            work()
            os._exit(0)  # all that is open here is the parent's to close
    finally:
        os._exit(1)


@contextmanager
def without_interrupts(*, forked: bool) -> Iterator[None]:
    """
    Hold SIGINT back, so that processes that are started meanwhile never end by it.

    Ctrl-C is sent to them as well, and where they are still loading nobody would catch it. Each
    calls ``ignore_interrupts`` then; this process gets what came when the block has ended.
    """
    if not forked:
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


def begun(
    beside: Any,
    name: str,
    target: Callable[..., None],
    args: Sequence[Any],
    ours: Sequence[Connection] = (),
) -> Any:
    """
    Return a process of the context ``beside`` that runs ``target(*args)``, not longer than this.

    It is killed with this process, where its main thread begins it: Linux would kill it with any
    other thread. Ctrl-C is left to this process.
    ``ours`` are the ends of its pipes that stay here. It closes its copies, to hear when they are
    closed here; copies of this process that are made later have them until they end.
    """
    parent = os.getpid() if current_thread() is main_thread() else None
    given = (parent, ours if is_forked(beside) else (), target, args)
    process = beside.Process(target=_run, args=given, name=name, daemon=True)
    with without_interrupts(forked=is_forked(beside)):
        process.start()
    return process


def _run(
    parent: int | None,
    theirs: Sequence[Connection],
    target: Callable[..., None],
    args: Sequence[Any],
) -> None:
    ignore_interrupts()
    signal.signal(signal.SIGTERM, signal.SIG_DFL)  # what a command does then is not for its copy
    for end in theirs:
        end.close()
    # A pipe that is closed is not heard where other work has the cores, and this one waits.
    if parent is None or end_with(parent):
        target(*args)


def work_beside() -> None:
    """Let this process run only where no other wants the core."""
    os.sched_setscheduler(0, os.SCHED_IDLE, os.sched_param(0))


def hurry(pid: int | None) -> None:
    """Let the process ``pid`` run like any other again: somebody waits for it now."""
    if pid is not None:
        with suppress(OSError):  # it has died, or may not: then in the time that is left
            os.sched_setscheduler(pid, os.SCHED_OTHER, os.sched_param(0))


def main() -> None:
    """Run the module, unless the parent has ended meanwhile."""
    _, parent, *command = sys.argv
    if end_with(int(parent)):
        sys.argv[:] = command
        runpy.run_module(command[0], run_name='__main__', alter_sys=True)


if __name__ == '__main__':
    main()
