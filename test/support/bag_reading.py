"""Serialized messages to record, bags read back by rosbags, and a disk that ends."""

from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
import os
from pathlib import Path
import resource
import time

import pytest
from rosbags.highlevel import AnyReader
from rosbags.typesys import get_typestore, Stores

from visual_servo_epipolar.bags.reading.bag import storage_files
from visual_servo_epipolar.bags.recording.recorder import Recorder, Topic
from visual_servo_epipolar.bags.recording.settings import RecordSettings

STORE = get_typestore(Stores.ROS2_JAZZY)
TEXT = 'std_msgs/msg/String'
WORDS = Topic('/words', TEXT)


def words(text: str) -> bytes:
    """Return a serialized std_msgs/String."""
    return bytes(STORE.serialize_cdr(STORE.types[TEXT](text), TEXT))


def recorded(folder: Path, **settings: object) -> Path:
    """Record a bag with a hundred messages of ``/words``."""
    bag = folder / 'bag'
    recorder = Recorder(bag, RecordSettings(**settings))
    recorder.add(WORDS)
    for number in range(100):
        recorder.put(WORDS, number, words(f'{number:05000}'))
    recorder.close()
    return bag


def read_back(path: Path) -> list[tuple[str, int, bytes]]:
    """Return topic, stamp and bytes of all messages of a bag, or one that was repaired."""
    with AnyReader(storage_files(path) if path.is_dir() else [path]) as reader:
        return [(item.topic, stamp_ns, data) for item, stamp_ns, data in reader.messages()]


def texts_in(bag: Path, topic: str = '/words') -> list[str]:
    """Return the texts of one topic in a bag, in their order."""
    found = [data for name, _, data in read_back(bag) if name == topic]
    return [STORE.deserialize_cdr(data, TEXT).data for data in found]


def size_of(folder: Path) -> int:
    """Return the bytes of all files below ``folder``; who writes may remove one meanwhile."""
    size = 0
    for path in folder.rglob('*'):
        with suppress(FileNotFoundError):  # such as a journal of SQLite
            size += path.stat().st_size if path.is_file() else 0
    return size


def until(condition: Callable[[], bool], waiting_for: str, timeout_sec: float = 10.0) -> None:
    """Wait until ``condition``; fail naming what was waited for if that takes too long."""
    deadline = time.monotonic() + timeout_sec
    while not condition():
        if time.monotonic() > deadline:
            pytest.fail(f'waited {timeout_sec:g} s in vain for {waiting_for}')
        os.sched_yield()


@contextmanager
def files_of_at_most(size: int) -> Iterator[None]:
    """Let no file of this process grow beyond ``size`` bytes: a disk that is full, to it."""
    soft, hard = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (size, hard))
    try:
        yield
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, (soft, hard))
