"""How a command ends early: by Ctrl-C or SIGTERM, or as nobody reads its output any more."""

from collections.abc import Iterator
from contextlib import contextmanager
import os
import select
import signal
import sys
import threading
from typing import Any, NoReturn

INTERRUPTED, TERMINATED = 130, 143
CODES = {signal.SIGINT: INTERRUPTED, signal.SIGTERM: TERMINATED}
STREAMS = (1, 2)
AGAIN_S = 0.001


class Terminated(KeyboardInterrupt):
    """SIGTERM came: all ends as after Ctrl-C, with its own exit code."""


def leave_at_once(who: str) -> None:
    """
    Let SIGINT and SIGTERM end this process from now on, by one line and their exit code.

    That is for the time in which modules are loaded, and nothing has begun that is to be tidied
    up: an exception within an import becomes whatever its module makes of it.
    """

    def leave(number: int, _: object) -> NoReturn:
        os.write(STREAMS[1], f'{who}: interrupted\n'.encode())
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
    signals = _Signals()
    try:
        yield
    except BaseException:
        signals.end()
        raise
    finally:
        signals.restore()
    signals.end()


class _Signals:
    """SIGINT and SIGTERM as exceptions, and which of them came."""

    def __init__(self) -> None:
        self._came: type[KeyboardInterrupt] | None = None
        self._before: dict[int, Any] = {
            number: signal.signal(number, self._raise)
            for number in (*CODES, signal.SIGALRM)
            if signal.getsignal(number) is not signal.SIG_IGN
        }
        self._hook, sys.unraisablehook = sys.unraisablehook, self._again

    def restore(self) -> None:
        """Leave the signals to whom they belonged."""
        sys.unraisablehook = self._hook
        signal.setitimer(signal.ITIMER_REAL, 0.0)
        for number, handler in self._before.items():
            if handler is not None:  # of C, which cannot be set again
                signal.signal(number, handler)

    def end(self) -> None:
        """Raise what came, if anything did."""
        if self._came is not None:
            raise self._came from None

    def _raise(self, number: int, _: object) -> NoReturn:
        if number == signal.SIGTERM:
            signal.signal(number, signal.SIG_IGN)
            self._came = Terminated
        self._came = self._came or KeyboardInterrupt
        raise self._came

    def _again(self, lost: 'sys.UnraisableHookArgs') -> None:
        """Raise once more what Python would print and forget: it was raised in a destructor."""
        if issubclass(lost.exc_type, KeyboardInterrupt):
            signal.setitimer(signal.ITIMER_REAL, AGAIN_S)
        else:
            self._hook(lost)


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
            # Print no more to it: the interpreter would complain about it at its end.
            null = os.open(os.devnull, os.O_WRONLY)
            os.dup2(null, stream.fileno())
            os.close(null)
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
