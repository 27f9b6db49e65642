"""
Bags open for reading: rosbag2 (mcap, sqlite3) of any distribution, by rosbags.

Any defect of a bag becomes one InputError: the library raises errors of every kind on damage.
"""

from collections.abc import Collection, Iterator
from contextlib import AbstractContextManager, contextmanager, ExitStack
from dataclasses import dataclass
import errno
import heapq
from operator import attrgetter
from pathlib import Path
import struct
from typing import Any

from mcap.exceptions import McapError
from rosbags.interfaces import Connection, MessageDefinitionFormat
from rosbags.rosbag2 import Reader, ReaderError
from rosbags.serde import SerdeError
from rosbags.typesys import get_types_from_idl, get_types_from_msg, TypesysError
from zstandard import ZstdError

from visual_servo_epipolar.bags.definitions import METADATA, types_of_ros
from visual_servo_epipolar.core.errors import InputError

DAMAGE = (
    McapError,
    ReaderError,
    SerdeError,
    TypesysError,
    struct.error,
    ZstdError,
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
NO_DAMAGE = (errno.EACCES, errno.EPERM, errno.ENOSPC, errno.EDQUOT, errno.EIO, errno.EMFILE)
SUFFIXES = ('.mcap', '.db3')
EXPECTED = 'give a rosbag2 folder, a .mcap or a .db3 file'
REPAIRED = '.repaired.mcap'  # end of the name of a file with the remains of a damaged one
ADVICE = {
    '.db3': 'if it is damaged, try "sqlite3 {name} .recover | sqlite3 NEW.db3"',
    '.zstd': 'unpack it with "zstd -d {name}", or give its folder',
    '.bag': 'convert a bag of ROS 1 with "rosbags-convert --src {name} --dst NEW"',
}


@dataclass(frozen=True, slots=True)
class BagTopic:
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
    Bag open for reading: a rosbag2 folder, or one of its files; of them the topics of ROS.

    ``notes`` say which topics are left out; of a bag that is ``repaired`` already no error asks
    for a repair.

    Raises InputError here and from every method, if the bag is missing, damaged, or of an unknown
    kind.
    """

    def __init__(self, path: Path, *, repaired: bool = False) -> None:
        self._repaired = repaired
        self.path = path.parent if path.name == METADATA and path.is_file() else path
        with self._intact(), ExitStack() as stack:
            files = _to_open(self.path)
            self._readers = [stack.enter_context(open_file(item)) for item in files]
            self._stack = stack.pop_all()
        stored = [item for reader in self._readers for item in reader.connections]
        left_out = sorted({item.topic for item in stored if not _is_readable(item)})
        reason = 'left out, for their messages or the definitions of their types are not of ROS'
        self.notes = [f'{reason}: {", ".join(left_out)}'] if left_out else []
        self.topics = self._topics()
        if stored and not self.topics:
            self._stack.close()
            raise InputError(f'{self.path}: none of its topics can be read: {self.notes[0]}')

    def __exit__(self, *_: object) -> None:
        with self._intact():
            self._stack.close()

    def messages(self, names: Collection[str]) -> Iterator[RecordedMessage]:
        """Yield the messages of the topics called ``names`` in the order of recording."""
        streams = []
        for reader in self._readers:
            chosen = [it for it in reader.connections if it.topic in names and _is_readable(it)]
            for item in chosen:
                with self._intact():
                    self._check_definition(item)
            if chosen:
                streams.append(self._stream(reader, chosen))
        yield from heapq.merge(*streams, key=attrgetter('log_ns'))

    def _stream(self, reader: Reader, chosen: list[Connection]) -> Iterator[RecordedMessage]:
        stored = reader.messages(chosen)
        while True:
            with self._intact():
                try:
                    topic, log_ns, raw = next(stored)
                except StopIteration:
                    return
                message = types_of_ros().deserialize_cdr(raw, topic.msgtype)
            yield RecordedMessage(topic.topic, log_ns, message)

    @contextmanager
    def _intact(self) -> Iterator[None]:
        """Turn whatever damage raises into one InputError that names the bag, and what to do."""
        try:
            yield
        except InputError:
            raise
        except DAMAGE as error:
            if isinstance(error, OSError) and error.errno in NO_DAMAGE:
                raise InputError(f'{self.path}: bag cannot be read: {error.strerror}') from error
            reason = words_of(error)
            advice = 'if it is damaged, or was left open by a crash, try --repair'
            if advice := ADVICE.get(self.path.suffix, '' if self._repaired else advice):
                reason += f'; {advice.format(name=self.path.name)}'
            raise InputError(f'{self.path}: bag cannot be read: {reason}') from error

    def _check_definition(self, item: Connection) -> None:
        """Refuse a type whose definition in the bag differs from that of ROS."""
        if item.msgdef.format == MessageDefinitionFormat.NONE:
            return
        if item.msgdef.format == MessageDefinitionFormat.MSG:
            definitions = get_types_from_msg(item.msgdef.data, item.msgtype)
        else:
            definitions = get_types_from_idl(item.msgdef.data)
        for name, (_, fields) in definitions.items():
            expected = types_of_ros().fielddefs.get(name)
            if expected is None or expected[1] != fields:
                raise InputError(
                    f'{self.path}: {item.topic}: {name} is defined otherwise than in ROS; '
                    'the bag is damaged, or convert it'
                )

    def _topics(self) -> dict[str, BagTopic]:
        topics: dict[str, BagTopic] = {}
        stored = (item for reader in self._readers for item in reader.connections)
        for item in sorted(filter(_is_readable, stored), key=attrgetter('topic')):
            earlier = topics.get(item.topic)
            if earlier is not None and earlier.kind != item.msgtype:
                raise InputError(
                    f'{self.path}: {item.topic} has messages of {earlier.kind} and '
                    f'{item.msgtype}; a topic must have one type'
                )
            count = item.msgcount + (0 if earlier is None else earlier.count)
            topics[item.topic] = BagTopic(item.topic, item.msgtype, count)
        return topics


def _is_readable(item: Connection) -> bool:
    is_defined = item.msgdef.format != MessageDefinitionFormat.NONE
    return getattr(item.ext, 'serialization_format', '') == 'cdr' and (
        is_defined or item.msgtype in types_of_ros().fielddefs
    )


def storage_files(folder: Path) -> list[Path]:
    """Return the storage files in ``folder`` in their order, repaired ones for damaged ones."""
    files = [it for it in folder.iterdir() if it.suffix in SUFFIXES and it.is_file()]
    names = {item.name for item in files}
    kept = (item for item in files if f'{item.stem}{REPAIRED}' not in names)
    return sorted(kept, key=lambda item: (len(item.name.partition('.')[0]), item.name))


def _to_open(path: Path) -> list[Path]:
    """Return the folder of a bag where its metadata hold, else its storage files."""
    if not path.exists():
        raise InputError(f'{path}: no such bag; {EXPECTED}')
    if not path.is_dir():
        return [path]
    files = storage_files(path)
    has_repaired = any(item.name.endswith(REPAIRED) for item in files)
    if (path / METADATA).is_file() and not has_repaired:
        return [path]
    if not files:
        bags = sorted(item.parent for item in path.glob(f'*/{METADATA}'))
        what = f', but a folder with one; give {bags[0]}' if bags else f'; {EXPECTED}'
        raise InputError(f'{path}: not a bag{what}')
    return files


def open_file(path: Path) -> Reader:
    """Return a reader of a storage file or a folder, to be opened; InputError for others."""
    if path.is_file():
        if path.suffix not in SUFFIXES:
            advice = ADVICE.get(path.suffix, EXPECTED).format(name=path.name)
            raise InputError(f'{path}: not a bag that can be read; {advice}')
        if path.stat().st_size == 0:
            raise InputError(f'{path}: it is empty, nothing was recorded; give another bag')
    for file in path.glob('*.db3') if path.is_dir() else [path]:
        log = file.with_name(f'{file.name}-wal')
        if log.is_file() and log.stat().st_size:
            raise InputError(
                f'{path}: a killed recorder left messages in {log.name}; write them to the bag '
                f'with "sqlite3 {file.name} \'PRAGMA wal_checkpoint(TRUNCATE)\'"'
            )
    return Reader(path)


def words_of(error: Exception) -> str:
    """Return what a library says of damage, in one line."""
    if isinstance(error, KeyError):  # of an encoding of messages or definitions
        return f'unknown {error}; what is not of ROS 2 can be left out by "mcap filter"'
    text = getattr(error, 'strerror', None) or str(error)
    return f'{" ".join(text.split()).rstrip(".") or type(error).__name__:.300}'
