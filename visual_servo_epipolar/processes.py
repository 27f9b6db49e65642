"""Processes beside this one: copies of it where that is safe, otherwise new ones."""

from collections.abc import Callable, Sequence
import ctypes
from multiprocessing import get_context
from multiprocessing.connection import Connection
import os
from pathlib import Path
import signal
from typing import Any

THREADS = Path('/proc/self/task')  # of Linux
PR_SET_PDEATHSIG = 1


def may_fork() -> bool:
    """Return whether this process has one thread: what others lock stays locked in a copy."""
    return THREADS.is_dir() and len(list(THREADS.iterdir())) == 1


def context() -> Any:
    """
    Return multiprocessing's context of processes that are started now.

    A fork has all that is loaded here, for which a new process takes up to a second.
    """
    return get_context('fork' if may_fork() else 'spawn')


def is_forked(context: Any) -> bool:
    """Return whether processes of ``context`` have what is loaded here."""
    return bool(context.get_start_method() == 'fork')


def copied(work: Callable[[], object]) -> Callable[[], bool]:
    """
    Begin ``work`` in a copy of this process, which may fork; return what waits for its end.

    That returns whether the work was done. The copy ends with this process at the latest, which
    may be one of multiprocessing itself: those make no others.
    """
    parent = os.getpid()
    pid = os.fork()
    if pid:
        return lambda: os.waitpid(pid, 0)[1] == 0
    try:
        ctypes.CDLL(None).prctl(PR_SET_PDEATHSIG, signal.SIGKILL)
        if os.getppid() == parent:
            work()
            os._exit(0)  # all that is open here is the parent's to close
    finally:
        os._exit(1)


def begun(
    context: Any,
    name: str,
    target: Callable[..., None],
    args: Sequence[Any],
    ours: Sequence[Connection] = (),
) -> Any:
    """
    Return a process that runs ``target(*args)``, and ends with this one at the latest.

    ``ours`` are the ends of its pipes that stay here: no copy of them is left there, for it to
    hear when they are closed.
    """
    given = (ours if is_forked(context) else (), target, args)
    process = context.Process(target=_run, args=given, name=name, daemon=True)
    process.start()
    return process


def _run(theirs: Sequence[Connection], target: Callable[..., None], args: Sequence[Any]) -> None:
    for end in theirs:
        end.close()
    target(*args)
