"""Transport of a process: shared memory and buffers for images, and how far it sees."""

from collections.abc import Iterator
from contextlib import contextmanager
import ctypes
import os
from pathlib import Path
import sys

MALLOPT_MMAP_THRESHOLD, MALLOPT_TRIM_THRESHOLD = -3, -1
KEEP_BYTES = 2**29 - 1
DISCOVERY = ('ROS_AUTOMATIC_DISCOVERY_RANGE', 'ROS_LOCALHOST_ONLY', 'ROS_STATIC_PEERS')


def tune_transport() -> None:
    """
    Tune the transport for images: shared memory for whole frames, and buffers that are kept.

    The default segment is smaller than one image, and glibc returns megabyte buffers to the
    kernel after each message. Both are settings of this process alone; a profile of the user's
    own (FASTRTPS_DEFAULT_PROFILES_FILE) is left as it is.
    """
    profile = Path(__file__).with_name('fastdds_profile.xml')
    if profile.is_file():
        os.environ.setdefault('FASTRTPS_DEFAULT_PROFILES_FILE', str(profile))
    if sys.platform == 'linux':
        libc = ctypes.CDLL(None)
        if hasattr(libc, 'mallopt'):
            libc.mallopt(MALLOPT_MMAP_THRESHOLD, KEEP_BYTES)
            libc.mallopt(MALLOPT_TRIM_THRESHOLD, KEEP_BYTES)


@contextmanager
def discovery_range(reach: str) -> Iterator[None]:
    """
    Let nodes that are made meanwhile see others as far as ``reach`` says.

    OFF is this process, LOCALHOST this machine, SUBNET all that can be seen.
    """
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
