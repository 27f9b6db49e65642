"""
Bags open for reading: rosbag2 (mcap, sqlite3) of any distribution and ROS 1, whole or damaged.

Any defect of a bag becomes one InputError: the libraries that decode it raise errors of every
kind on damage.
"""

from collections.abc import Collection, Iterator
from contextlib import AbstractContextManager, contextmanager, ExitStack, suppress
from dataclasses import dataclass
import errno
import heapq
from operator import attrgetter, itemgetter
from pathlib import Path
import sqlite3
import struct
from typing import Any

from mcap.exceptions import McapError
from rosbags import rosbag1
from rosbags.serde import SerdeError
from rosbags.typesys import get_types_from_idl, get_types_from_msg, TypesysError
import zstandard

from visual_servo_epipolar.bags import containers
from visual_servo_epipolar.bags.containers import ADVICE, bag_parts, ZSTD_MAGIC
from visual_servo_epipolar.bags.storages import (
    IDL_LANGUAGES,
    kind_of,
    left_out,
    MESSAGE_LANGUAGES,
    open_storage,
    refusal,
    ROS1,
    StorageFile,
    StoredTopic,
    types_of,
)
from visual_servo_epipolar.core.errors import InputError

DAMAGE = (
    McapError,
    rosbag1.ReaderError,
    SerdeError,
    TypesysError,
    sqlite3.Error,
    struct.error,
    zstandard.ZstdError,
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
PLAIN_WORDS: dict[type[Exception], str] = {
    MemoryError: 'it states sizes beyond all memory',
    RecursionError: 'it is nested too deeply',
}
NO_DAMAGE = (errno.EACCES, errno.EPERM, errno.ENOSPC, errno.EDQUOT, errno.EIO, errno.EMFILE)
OTHER_ADVICE = {
    'ros1': 'the bag is damaged or was left open; try "rosbag reindex" of ROS 1',
    'sqlite3': 'it is damaged; try "sqlite3 {name} .recover | sqlite3 NEW.db3"',
    'zstd': 'it is damaged; unpack what is there with "zstd -dc {name} > {plain}" and repair it',
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
    Bag open for reading: a rosbag2 folder, one of its files, a ROS 1 .bag; of them ROS's topics.

    ``notes`` say which topics and files are left out.

    Raises InputError here and from every method, if the bag is missing, damaged, or of an unknown
    kind.
    """

    def __init__(self, path: Path) -> None:
        self.path = containers.bag_path(path)
        with intact(self.path), ExitStack() as stack:
            parts, notes = bag_parts(self.path)
            unpacked = (stack.enter_context(containers.unpack(item)) for item in parts)
            self._files = [stack.enter_context(open_storage(item)) for item in unpacked]
            self._stack = stack.pop_all()
        stored = [item for file in self._files for item in file.topics]
        self._stored = [item for item in stored if not refusal(item)]
        self.notes = [*notes, *left_out(stored)]
        if stored and not self._stored:
            self._stack.close()
            raise InputError(
                f'{self.path}: none of its topics can be read: {"; ".join(self.notes)}; record '
                'topics of ROS with "ros2 bag record", or convert these to its messages'
            )
        self.topics = self._topics()

    def __exit__(self, *_: object) -> None:
        with intact(self.path):
            self._stack.close()

    def messages(self, names: Collection[str]) -> Iterator[RecordedMessage]:
        """Yield the messages of the topics called ``names`` in the order of recording."""
        for item in self._stored:
            if item.topic in names:
                with intact(self.path):
                    self._check_definition(item)
        # A file is opened when its time has come: there may be hundreds.
        streams = [self._stream(file, names) for file in self._files]
        for _, recorded in heapq.merge(*streams, key=itemgetter(0)):
            if recorded is not None:
                yield recorded

    def _stream(
        self, file: StorageFile, names: Collection[str]
    ) -> Iterator[tuple[int, RecordedMessage | None]]:
        chosen = {
            item.id: item for item in file.topics if item.topic in names and not refusal(item)
        }
        if not chosen:
            return
        yield file.start_ns, None
        stored = file.messages(chosen.keys())
        while True:
            with intact(self.path):
                try:
                    number, log_ns, raw = next(stored)
                except StopIteration:
                    return
                topic = chosen[number]
                message = _decode(topic, raw)
            yield log_ns, RecordedMessage(topic.topic, log_ns, message)

    def _check_definition(self, item: StoredTopic) -> None:
        """Refuse a type whose definition in the bag differs from that of ROS."""
        if item.definition and item.schema in MESSAGE_LANGUAGES:
            definitions = get_types_from_msg(item.definition, kind_of(item))
        elif item.definition and item.schema in IDL_LANGUAGES:
            definitions = get_types_from_idl(item.definition)
        else:
            return
        types = types_of(item.encoding)
        for name, (_, fields) in definitions.items():
            expected = types.fielddefs.get(name)
            if expected is None or expected[1] != fields:
                raise InputError(
                    f'{self.path}: {item.topic}: {name} is defined otherwise than in ROS; '
                    'the bag is damaged, or convert it'
                )

    def _topics(self) -> dict[str, BagTopic]:
        topics: dict[str, BagTopic] = {}
        for item in sorted(self._stored, key=attrgetter('topic')):
            earlier, kind = topics.get(item.topic), kind_of(item)
            if earlier is not None and earlier.kind != kind:
                raise InputError(
                    f'{self.path}: {item.topic} has messages of {earlier.kind} and {kind}; a '
                    'topic must have one type'
                )
            count = item.count + (0 if earlier is None else earlier.count)
            topics[item.topic] = BagTopic(item.topic, kind, count)
        return topics


@contextmanager
def intact(path: Path) -> Iterator[None]:
    """Turn whatever damage raises into one InputError that names the bag, and what to do."""
    try:
        yield
    except OSError as error:
        if error.errno not in NO_DAMAGE:
            raise _unreadable(path, error) from error
        raise InputError(f'{path}: bag cannot be read: {error.strerror}') from error
    except InputError:
        raise
    except DAMAGE as error:
        raise _unreadable(path, error) from error


def _unreadable(path: Path, error: Exception) -> InputError:
    return InputError(f'{path}: bag cannot be read: {words_of(error)}; {advice(path)}')


def words_of(error: Exception) -> str:
    """Return what a library says of damage, in one line."""
    text = getattr(error, 'strerror', None) or str(error)
    words = ' '.join(text.split()).replace("('", '').replace("',)", '')  # of rosbags
    return f'{PLAIN_WORDS.get(type(error)) or words or type(error).__name__:.300}'


def advice(path: Path) -> str:
    """Return what to do about a damaged bag, by what it is."""
    text = ADVICE
    if path.is_file():
        with suppress(InputError, *DAMAGE):  # its beginning is damaged as well
            text = OTHER_ADVICE.get(containers.container(path), ADVICE)
    return text.format(name=path.name, plain=path.name.removesuffix('.zstd'))


def _decode(topic: StoredTopic, raw: bytes) -> Any:
    types, kind = types_of(topic.encoding), kind_of(topic)
    if topic.encoding == ROS1:
        return types.deserialize_ros1(raw, kind)
    if raw.startswith(ZSTD_MAGIC):  # message by message, which only metadata.yaml would say
        raw = zstandard.ZstdDecompressor().decompressobj().decompress(raw)
    return types.deserialize_cdr(raw, kind)
