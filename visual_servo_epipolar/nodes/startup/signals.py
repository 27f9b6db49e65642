"""Signals that end a node: Ctrl-C, kill, a terminal that is closed, Ctrl-backslash."""

from collections.abc import Callable
import signal

ENDING = (signal.SIGINT, signal.SIGTERM, signal.SIGHUP, signal.SIGQUIT)


def on_ending(action: Callable[[signal.Signals], None]) -> None:
    """Let ``action`` be called, with the signal, in place of what would kill the process."""
    for number in ENDING:
        # Who starts a node by nohup wants it to outlive its terminal.
        if number is signal.SIGHUP and signal.getsignal(number) is signal.SIG_IGN:
            continue
        signal.signal(number, lambda received, _: action(signal.Signals(received)))


def ignore_ending() -> None:
    """Ignore these signals from now on: a second Ctrl-C finds nothing left to end."""
    for number in ENDING:
        signal.signal(number, signal.SIG_IGN)
