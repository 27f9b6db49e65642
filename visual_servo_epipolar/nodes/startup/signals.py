"""Signals that end a node: Ctrl-C, kill, a terminal that is closed, Ctrl-backslash; and Ctrl-Z."""

from collections.abc import Callable
import os
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


def on_suspending(action: Callable[[], None]) -> None:
    """Let ``action`` be called in place of what Ctrl-Z does: it stops a node, not the robot."""
    if signal.getsignal(signal.SIGTSTP) is not signal.SIG_IGN:
        signal.signal(signal.SIGTSTP, lambda *_: action())


def suspend() -> None:
    """Suspend this process, until SIGCONT."""
    os.kill(os.getpid(), signal.SIGSTOP)
