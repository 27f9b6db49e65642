"""How a command ends early: by Ctrl-C or SIGTERM, or when its output is no longer read."""

from collections.abc import Iterator
from contextlib import contextmanager
import os
import signal
import sys
import threading
from typing import NoReturn

INTERRUPTED, TERMINATED = 130, 143
CODES = {signal.SIGINT: INTERRUPTED, signal.SIGTERM: TERMINATED}
STDERR = 2


class Terminated(KeyboardInterrupt):
    """SIGTERM came: all ends as after Ctrl-C, with its own exit code."""


def leave_at_once(name: str) -> None:
    """
    Let SIGINT and SIGTERM end this process from now on, by one line and their exit code.

    That is for the time in which modules are loaded, and nothing has begun that is to be tidied
    up: an exception within an import becomes whatever its module makes of it.
    """

    def leave(number: int, _: object) -> NoReturn:
        os.write(STDERR, f'{name}: interrupted\n'.encode())
        os._exit(CODES[signal.Signals(number)])

    for number in CODES:
        if signal.getsignal(number) is not signal.SIG_IGN:  # of a shell's background
            signal.signal(number, leave)


def leave_no_more() -> None:
    """Ignore SIGINT and SIGTERM from now on: all is done, and the exit code is known."""
    for number in CODES:
        signal.signal(number, signal.SIG_IGN)


@contextmanager
def terminable() -> Iterator[None]:
    """
    Raise KeyboardInterrupt in the block at SIGINT, and Terminated at the first SIGTERM.

    SIGTERMs that follow change nothing: timeout(1) sends it twice, and the second one must not
    cut off the tidying up. Whatever a library that was being loaded makes of the exception, and
    where it is lost as in a destructor: the block ends by it.
    """
    if threading.current_thread() is not threading.main_thread():
        yield  # signals are none of its business
        return
    received: list[type[KeyboardInterrupt]] = []

    def interrupt(number: int, _: object) -> NoReturn:
        if number == signal.SIGTERM:
            signal.signal(number, signal.SIG_IGN)
        received.append(Terminated if number == signal.SIGTERM else KeyboardInterrupt)
        raise received[-1]

    heard = [it for it in CODES if signal.getsignal(it) is not signal.SIG_IGN]
    before = {number: signal.signal(number, interrupt) for number in heard}
    try:
        yield
    except BaseException:
        if not received:
            raise
    finally:
        for number, handler in before.items():
            if handler is not None:  # of C, which cannot be set again
                signal.signal(number, handler)
    if received:
        raise Terminated if Terminated in received else KeyboardInterrupt


def unread() -> bool:
    """
    Write out what was printed; return whether it is no longer read, as after ``| head``.

    Raises OSError where it cannot be written for another reason.
    """
    closed = False
    for stream in filter(None, (sys.stdout, sys.stderr)):  # None if closed from the start
        try:
            stream.flush()
        except OSError as error:
            # Print no more to it: the interpreter would complain about it at its end.
            null = os.open(os.devnull, os.O_WRONLY)
            os.dup2(null, stream.fileno())
            os.close(null)
            if not isinstance(error, BrokenPipeError):
                raise
            closed = True
    return closed
