"""Process of a node: the signals that end or suspend it, its transport, how far it sees."""

from collections.abc import Callable, Iterator
from contextlib import contextmanager
import ctypes
import os
from pathlib import Path
import signal
import sys

KEEP_BYTES = 2**23  # an image of 8 MB; a match of whole images takes 300 MB for a moment
DISCOVERY = ('ROS_AUTOMATIC_DISCOVERY_RANGE', 'ROS_LOCALHOST_ONLY', 'ROS_STATIC_PEERS')
# Ctrl-C, kill, a terminal that is closed, Ctrl-backslash.
ENDING = (signal.SIGINT, signal.SIGTERM, signal.SIGHUP, signal.SIGQUIT)


def tune_transport(*, sends_images: bool = True) -> None:
    """
    Tune the transport for images: shared memory for whole frames, and buffers that are kept.

    The default segment is smaller than one image that is sent, and glibc returns megabyte buffers
    to the kernel after each message; those larger than an image, of a matching, may go back. Both
    are settings of this process alone; a profile of the user's own
    (FASTRTPS_DEFAULT_PROFILES_FILE) is left as it is.
    """
    profile = Path(__file__).with_name('fastdds_profile.xml')
    if sends_images and profile.is_file():
        os.environ.setdefault('FASTRTPS_DEFAULT_PROFILES_FILE', str(profile))
    if sys.platform == 'linux':
        libc = ctypes.CDLL(None)
        if hasattr(libc, 'mallopt'):
            for option in (-3, -1):  # M_MMAP_THRESHOLD, M_TRIM_THRESHOLD
                libc.mallopt(option, KEEP_BYTES)


@contextmanager
def discovery_range(reach: str) -> Iterator[None]:
    """Let new nodes see this process (OFF), this machine (LOCALHOST), or all (SUBNET)."""
    # The older variables would overrule the range.
    before = {name: os.environ.pop(name, None) for name in DISCOVERY}
    os.environ[DISCOVERY[0]] = reach
    try:
        yield
    finally:
        for name, value in before.items():
            os.environ.pop(name, None)
            if value is not None:
                os.environ[name] = value


def on_ending(action: Callable[[signal.Signals], None]) -> None:
    """Let ``action`` be called, with the signal, in place of what would kill the process."""
    for number in ENDING:
        # A node that is started by nohup is to outlive its terminal.
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
