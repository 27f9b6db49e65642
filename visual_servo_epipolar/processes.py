"""Processes beside this one: copies of it where that is safe, otherwise new ones."""

from collections.abc import Callable, Sequence
from multiprocessing import get_context
from multiprocessing.connection import Connection
from pathlib import Path
from typing import Any

THREADS = Path('/proc/self/task')


def context() -> Any:
    """
    Return multiprocessing's context of processes that are started now.

    A fork has all that is loaded here, for which a new process takes up to a second. But what
    another thread has locked stays locked in the copy: only a process of one thread is forked.
    """
    alone = THREADS.is_dir() and len(list(THREADS.iterdir())) == 1
    return get_context('fork' if alone else 'spawn')


def is_forked(context: Any) -> bool:
    """Return whether processes of ``context`` have what is loaded here."""
    return bool(context.get_start_method() == 'fork')


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
