"""
Bags open for reading: rosbag2 (mcap, sqlite3) of any distribution and ROS 1, whole or damaged.

Whatever is wrong with a bag ends in one InputError: its bytes come from elsewhere, and the
libraries that decode them raise errors of every kind on damage.
"""

from collections.abc import Collection, Iterator
from contextlib import AbstractContextManager, contextmanager, ExitStack
from dataclasses import dataclass
from functools import cache
import heapq
from operator import itemgetter
from pathlib import Path
import struct
from typing import Any

from rosbags import rosbag1, rosbag2
from rosbags.interfaces import Connection, MessageDefinitionFormat
from rosbags.rosbag2.reader import zstd
from rosbags.rosbag2.storage_sqlite3 import apsw
from rosbags.serde import SerdeError
from rosbags.typesys import (
    get_types_from_idl,
    get_types_from_msg,
    get_typestore,
    Stores,
    TypesysError,
)
from rosbags.typesys.store import Typestore

from visual_servo_epipolar.bags import metadata
from visual_servo_epipolar.core.errors import InputError

STORAGE_SUFFIXES = ('.mcap', '.db3')
DAMAGE = (
    rosbag1.ReaderError,
    rosbag2.ReaderError,
    SerdeError,
    TypesysError,
    apsw.Error,
    struct.error,
    zstd.ZstdError,
    ArithmeticError,
    AssertionError,
    AttributeError,
    EOFError,
    LookupError,
    MemoryError,
    OSError,
    RuntimeError,
    TypeError,
    ValueError,
)
NAMELESS: dict[type[Exception], str] = {MemoryError: 'it states sizes beyond all memory'}
ADVICE = 'the bag is damaged or was left open by a crash; try --repair'


@dataclass(frozen=True, slots=True)
class Topic:
    """Topic of a bag: its name, its type as package/msg/Name, how many messages it has."""

    name: str
    kind: str
    count: int


@dataclass(frozen=True, slots=True, eq=False)
class RecordedMessage:
    """Message as it was recorded at ``log_ns``; fields as in ROS, arrays by numpy."""

    topic: str
    log_ns: int
    message: Any


class Bag(AbstractContextManager['Bag']):
    """
    Bag open for reading: a rosbag2 folder, one of its .mcap or .db3 files, a ROS 1 .bag.

    Raises
    ------
    InputError
        Here and from every method, if the bag is missing, damaged, or of an unknown kind.

    """

    def __init__(self, path: Path) -> None:
        self.path = path
        self._stack = ExitStack()
        with intact(path):
            self._readers = [self._stack.enter_context(_reader(item)) for item in _parts(path)]
            self._connections = [item for reader in self._readers for item in reader.connections]
        self._is_ros1 = path.suffix == '.bag'
        self._types = _types(self._is_ros1)
        self.topics = self._topics()

    def __exit__(self, *_: object) -> None:
        with intact(self.path):
            self._stack.close()

    def messages(self, names: Collection[str]) -> Iterator[RecordedMessage]:
        """Yield the messages of the topics called ``names`` in the order of recording."""
        chosen = [item for item in self._connections if item.topic in names]
        for connection in chosen:
            with intact(self.path):
                self._check_definition(connection)
        streams = [self._stream(reader, chosen) for reader in self._readers]
        yield from heapq.merge(*streams, key=lambda item: item.log_ns)

    def _stream(self, reader: Any, chosen: Collection[Connection]) -> Iterator[RecordedMessage]:
        own = [item for item in chosen if item in reader.connections]
        if not own:
            return
        raw_messages = reader.messages(own)
        while True:
            with intact(self.path):
                try:
                    connection, log_ns, raw = next(raw_messages)
                except StopIteration:
                    return
                message = self._decoded(raw, connection.msgtype)
            yield RecordedMessage(connection.topic, log_ns, message)

    def _decoded(self, raw: bytes, kind: str) -> Any:
        if self._is_ros1:
            return self._types.deserialize_ros1(raw, kind)
        return self._types.deserialize_cdr(raw, kind)

    def _check_definition(self, connection: Connection) -> None:
        """Refuse a type whose definition in the bag differs from that of ROS."""
        text, kind = connection.msgdef.data, connection.msgtype
        if connection.msgdef.format is MessageDefinitionFormat.MSG:
            definitions = get_types_from_msg(text, kind)
        elif connection.msgdef.format is MessageDefinitionFormat.IDL:
            definitions = get_types_from_idl(text)
        else:
            return
        for name, (_, fields) in definitions.items():
            expected = self._types.fielddefs.get(name)
            if expected is None or expected[1] != fields:
                raise InputError(
                    f'{self.path}: {connection.topic}: {name} is defined otherwise than in ROS; '
                    'the bag is damaged, or convert it'
                )

    def _topics(self) -> dict[str, Topic]:
        topics: dict[str, Topic] = {}
        for item in sorted(self._connections, key=itemgetter(1)):
            earlier = topics.get(item.topic)
            if earlier is not None and earlier.kind != item.msgtype:
                raise InputError(
                    f'{self.path}: {item.topic} has messages of {earlier.kind} and '
                    f'{item.msgtype}; a topic must have one type'
                )
            count = item.msgcount + (0 if earlier is None else earlier.count)
            topics[item.topic] = Topic(item.topic, item.msgtype, count)
        return topics


@contextmanager
def intact(path: Path) -> Iterator[None]:
    """Turn whatever damage raises into one InputError that names the bag."""
    try:
        yield
    except DAMAGE as error:
        text = ' '.join(str(error).split()) or NAMELESS.get(type(error), type(error).__name__)
        raise InputError(f'{path}: bag cannot be read: {text:.300}; {ADVICE}') from error


@cache
def _types(is_ros1: bool) -> Typestore:
    """Return the types of ROS; those read here have not changed since dashing."""
    return get_typestore(Stores.ROS1_NOETIC if is_ros1 else Stores.ROS2_JAZZY)


def _parts(path: Path) -> list[Path]:
    """Return what to open: the bag itself, or its files where metadata.yaml is missing."""
    if not path.exists():
        raise InputError(f'{path}: no such bag; give a rosbag2 folder, a .mcap, .db3 or .bag file')
    if not path.is_dir():
        if path.suffix not in (*STORAGE_SUFFIXES, '.bag'):
            raise InputError(
                f'{path}: not a bag; give a rosbag2 folder, a .mcap, .db3 or .bag file'
            )
        return [path]
    if (path / metadata.FILE).is_file():
        if metadata.listed_files(path) is None:
            raise InputError(
                f'{path}: bag cannot be read: {metadata.FILE} is empty or broken; {ADVICE}'
            )
        return [path]
    files = sorted(item for item in path.iterdir() if item.suffix in STORAGE_SUFFIXES)
    if not files:
        bags = sorted(item.parent for item in path.glob(f'*/{metadata.FILE}'))
        if bags:  # the folder of a demo, or one of several bags
            raise InputError(f'{path}: not a bag, but a folder with one; give {bags[0]}')
        raise InputError(
            f'{path}: not a bag: it has neither metadata.yaml nor .mcap or .db3 files; give the '
            'folder that was recorded, with --repair if a crash left it so'
        )
    return files


def _reader(path: Path) -> Any:
    return rosbag1.Reader(path) if path.suffix == '.bag' else rosbag2.Reader(path)
