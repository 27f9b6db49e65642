"""How a command ends early: SIGTERM as Ctrl-C does it, and output that nobody reads any more."""

from collections.abc import Iterator
from contextlib import contextmanager
import os
import select
import signal
import sys
import threading
from typing import NoReturn, TextIO

STREAMS = (1, 2)


class Terminated(KeyboardInterrupt):
    """SIGTERM came: all ends as after Ctrl-C, with its own exit code."""


@contextmanager
def terminable() -> Iterator[None]:
    """Raise Terminated in the block at the first SIGTERM; those that follow change nothing."""
    if threading.current_thread() is not threading.main_thread():
        yield  # signals are none of its business
        return
    before = signal.signal(signal.SIGTERM, _terminate)
    try:
        yield
    finally:
        signal.signal(signal.SIGTERM, before)


def _terminate(*_: object) -> NoReturn:
    # timeout(1) sends it twice, and the second one must not cut off the tidying up.
    signal.signal(signal.SIGTERM, signal.SIG_IGN)
    raise Terminated


def unread() -> bool:
    """
    Write out what was printed; return whether nobody reads it any more, as after ``| head``.

    Raises OSError where it cannot be written for another reason.
    """
    closed = False
    for stream in filter(None, (sys.stdout, sys.stderr)):  # None if closed from the start
        try:
            stream.flush()
        except OSError as error:
            _discard(stream)
            if not isinstance(error, BrokenPipeError):
                raise
            closed = True
    return closed


def reader_left(error: OSError) -> bool:
    """Whether ``error`` is that of printing to a pipe whose reader has left."""
    return isinstance(error, BrokenPipeError) and (unread() or any(map(_broken, STREAMS)))


def _broken(number: int) -> bool:
    """Whether a file descriptor is a pipe without a reader: unbuffered output is lost at once."""
    poll = select.poll()
    poll.register(number, 0)
    return any(event & (select.POLLERR | select.POLLHUP) for _, event in poll.poll(0))


def _discard(stream: TextIO) -> None:
    """Print no more to ``stream``: the interpreter would complain about it at its end."""
    null = os.open(os.devnull, os.O_WRONLY)
    os.dup2(null, stream.fileno())
    os.close(null)
