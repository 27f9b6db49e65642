"""
Storage files of bags, open for reading: mcap, sqlite3, ROS 1; nothing is written to them.

Bytes identify a file. mcap is read by its library, whatever profile and encoding it has;
databases of rosbag2, of any of its versions, by sqlite3; ROS 1 by rosbags.
"""

from collections import Counter
from collections.abc import Callable, Collection, Iterator, Mapping, Sequence
from contextlib import AbstractContextManager, closing, ExitStack
from dataclasses import dataclass
from functools import cache
import io
from itertools import pairwise
from operator import attrgetter
from pathlib import Path
import sqlite3
from typing import Any

from mcap.exceptions import EndOfFile, McapError
from mcap.reader import make_reader, NonSeekingReader
from mcap.records import Channel, Message, Schema
from mcap.summary import Summary
from mcap.writer import MCAP0_MAGIC
from rosbags import rosbag1
from rosbags.typesys import get_typestore, Stores

from visual_servo_epipolar.bags import containers
from visual_servo_epipolar.core.errors import InputError

CDR, ROS1 = 'cdr', 'ros1'  # the encodings of messages of ROS
StoredMessage = tuple[int, int, bytes]  # id of the topic, time of recording [ns], bytes
MESSAGE_LANGUAGES = ('ros1msg', 'ros2msg')
IDL_LANGUAGES = ('ros2idl', 'omgidl')
MOST_NAMED = 4  # topics that a note names
JOURNALS = ('-wal', '-journal')  # what SQLite puts behind the name of a database


@dataclass(frozen=True, slots=True)
class StoredTopic:
    """Topic as a storage file describes it; QoS is YAML, and what it does not say is empty."""

    id: int
    topic: str
    kind: str
    definition: str = ''
    schema: str = ''  # language of the definition: ros2msg, ros2idl, ros1msg, jsonschema, ...
    encoding: str = CDR  # of its messages: cdr, ros1, json, protobuf, ...
    qos: str = ''
    type_hash: str = ''
    count: int = 0


@dataclass(frozen=True, slots=True)
class StorageFile(AbstractContextManager['StorageFile']):
    """
    Storage file that is open; start and end [ns] are 0 where it has no messages.

    ``messages`` yields those of the topics of some ids, in the order of time.
    """

    topics: Sequence[StoredTopic]
    start_ns: int
    end_ns: int
    messages: Callable[[Collection[int]], Iterator[StoredMessage]]
    close: Callable[[], object] = lambda: None

    def __exit__(self, *_: object) -> None:
        self.close()


def open_storage(path: Path) -> StorageFile:
    """Open a storage file, which must be unpacked; raises InputError if it is none."""
    return FILES[containers.container(path)](path)


def kind_of(item: StoredTopic) -> str:
    """Return the type of a topic as package/msg/Name, which ROS 1 has as package/Name."""
    package, slash, name = item.kind.partition('/')
    return f'{package}/msg/{name}' if slash and '/' not in name else item.kind


@cache
def types_of(encoding: str) -> Any:
    """Return the types of ROS; those read here have not changed since dashing."""
    return get_typestore(Stores.ROS1_NOETIC if encoding == ROS1 else Stores.ROS2_JAZZY)


def refusal(item: StoredTopic) -> str:
    """Return why the messages of a topic are not read; empty if they are."""
    if item.encoding not in (CDR, ROS1):
        return f'their messages are {item.encoding or "of no known encoding"}, not of ROS'
    defined = item.schema in (*MESSAGE_LANGUAGES, *IDL_LANGUAGES) and item.definition
    if not defined and kind_of(item) not in types_of(item.encoding).fielddefs:
        return 'the definition of their type was not found when recording'
    return ''


def left_out(stored: Collection[StoredTopic]) -> list[str]:
    """Return a note for each reason why topics are left out, which names them."""
    reasons: dict[str, dict[str, None]] = {}
    for item in stored:
        if refusal(item):
            name = f'{item.topic} ({item.kind})' if item.kind else item.topic
            reasons.setdefault(refusal(item), {})[name] = None
    return [
        f'left out, for {reason}: {", ".join(list(names)[:MOST_NAMED])}'
        + (f' and {len(names) - MOST_NAMED} more' if len(names) > MOST_NAMED else '')
        for reason, names in reasons.items()
    ]


class ExactFile(io.BufferedReader):
    """File that returns all the bytes asked for, or raises EndOfFile: never fewer."""

    def __init__(self, path: Path) -> None:
        super().__init__(io.FileIO(path))
        self.size = path.stat().st_size

    def read(self, size: int | None = -1, /) -> bytes:
        """Read ``size`` bytes."""
        if size is not None and size > self.size - self.tell():
            raise EndOfFile(f'it ends at byte {self.size}, in the middle of a record')
        return super().read(size)


def _mcap_file(path: Path) -> StorageFile:
    """Open a file of mcap, read by its index, or from its beginning where it has none."""
    with ExactFile(path) as file:
        file.seek(-min(file.size, len(MCAP0_MAGIC)), io.SEEK_END)
        if file.read(len(MCAP0_MAGIC)) != MCAP0_MAGIC:
            raise McapError('its end is missing')
        file.seek(0)
        summary = make_reader(file).get_summary()
    return _scanned(path) if summary is None or not _is_index(summary) else _indexed(path, summary)


def _is_index(summary: Summary) -> bool:
    """Return whether messages can be found by a summary; each part of one is optional."""
    return (
        summary.statistics is not None
        and len(summary.channels) == summary.statistics.channel_count
        and {item.schema_id for item in summary.channels.values()} <= {0, *summary.schemas}
        and bool(summary.chunk_indexes)
        and all(item.message_index_offsets for item in summary.chunk_indexes)
    )


def _indexed(path: Path, summary: Summary) -> StorageFile:
    statistics = summary.statistics
    assert statistics is not None
    topics = _mcap_topics(summary.channels, summary.schemas, statistics.channel_message_counts)
    times = statistics.message_start_time, statistics.message_end_time

    def messages(ids: Collection[int]) -> Iterator[StoredMessage]:
        names = {summary.channels[number].topic for number in ids}
        with ExactFile(path) as file:
            for _, _, message in make_reader(file, validate_crcs=True).iter_messages(names):
                if message.channel_id in ids:
                    yield message.channel_id, message.log_time, message.data

    return StorageFile(topics, *(times if statistics.message_count else (0, 0)), messages)


def _scanned(path: Path) -> StorageFile:
    channels: dict[int, Channel] = {}
    schemas: dict[int, Schema] = {}
    counts: Counter[int] = Counter()
    times: list[int] = []
    for schema, channel, message in _every_message(path):
        if schema is not None:
            schemas[schema.id] = schema
        channels[channel.id] = channel
        counts[channel.id] += 1
        times.append(message.log_time)
    in_order = all(before <= after for before, after in pairwise(times))

    def messages(ids: Collection[int]) -> Iterator[StoredMessage]:
        chosen = (it for _, channel, it in _every_message(path) if channel.id in ids)
        for item in chosen if in_order else sorted(chosen, key=attrgetter('log_time')):
            yield item.channel_id, item.log_time, item.data

    topics = _mcap_topics(channels, schemas, counts)
    return StorageFile(topics, min(times, default=0), max(times, default=0), messages)


def _every_message(path: Path) -> Iterator[tuple[Schema | None, Channel, Message]]:
    with ExactFile(path) as file:
        reader = NonSeekingReader(file, validate_crcs=True, record_size_limit=file.size)
        yield from reader.iter_messages(log_time_order=False)


def _mcap_topics(
    channels: Mapping[int, Channel], schemas: Mapping[int, Schema], counts: Mapping[int, int]
) -> list[StoredTopic]:
    """Return the topics of channels; without a schema they have no type."""
    return [
        StoredTopic(
            channel.id,
            channel.topic,
            schema.name,
            schema.data.decode(errors='replace'),
            schema.encoding,
            channel.message_encoding,
            channel.metadata.get('offered_qos_profiles', ''),
            channel.metadata.get('topic_type_hash', ''),
            counts.get(channel.id, 0),
        )
        for channel in channels.values()
        for schema in [schemas.get(channel.schema_id) or Schema(0, b'', '', '')]
    ]


def journals(path: Path) -> list[Path]:
    """Return what a recorder that was killed left beside a database: it is part of it."""
    files = [path.resolve().with_name(path.resolve().name + ending) for ending in JOURNALS]
    return [item for item in files if item.is_file() and item.stat().st_size]


def _sqlite_file(path: Path) -> StorageFile:
    """Open a database; nothing is written to it, nor beside it unless it has a journal."""
    mode = 'mode=ro' if journals(path) else 'mode=ro&immutable=1'
    with ExitStack() as stack:
        uri = f'{path.resolve().as_uri()}?{mode}'
        db = stack.enter_context(closing(sqlite3.connect(uri, uri=True)))
        if not (_columns(db, 'topics') and _columns(db, 'messages')):
            raise InputError(f'{path}: a database without the tables of a bag; give another')
        rows = db.execute(
            'SELECT topic_id, COUNT(*), MIN(timestamp), MAX(timestamp) FROM messages '
            'GROUP BY topic_id'
        ).fetchall()
        start_ns = min((row[2] for row in rows), default=0)
        end_ns = max((row[3] for row in rows), default=0)
        topics = _sqlite_topics(db, {row[0]: row[1] for row in rows})
        stack.pop_all()

    def messages(ids: Collection[int]) -> Iterator[StoredMessage]:
        marks = ', '.join('?' * len(ids))
        return db.execute(
            f'SELECT topic_id, timestamp, data FROM messages WHERE topic_id IN ({marks}) '
            'ORDER BY timestamp',
            tuple(ids),
        )

    return StorageFile(topics, start_ns, end_ns, messages, db.close)


def _columns(db: sqlite3.Connection, table: str) -> set[str]:
    """Return the names of the columns of a table, none where it is not there."""
    return {row[1] for row in db.execute(f'PRAGMA table_info({table})')}


def _sqlite_topics(db: sqlite3.Connection, counts: Mapping[int, int]) -> list[StoredTopic]:
    """Return the topics of a database; earlier versions say less about them."""
    definitions: dict[str, tuple[str, str]] = {}
    if 'encoded_message_definition' in _columns(db, 'message_definitions'):
        for kind, text, schema in db.execute(
            'SELECT topic_type, encoded_message_definition, encoding FROM message_definitions '
            'WHERE topic_type IN (SELECT type FROM topics)'  # others may be damaged
        ):
            definitions.setdefault(kind, (text, schema))
    cursor = db.cursor()
    cursor.row_factory = sqlite3.Row
    return [
        StoredTopic(
            row['id'],
            row['name'],
            row['type'],
            *definitions.get(row['type'], ('', '')),
            row.get('serialization_format', CDR),
            row.get('offered_qos_profiles', ''),
            row.get('type_description_hash', ''),
            counts.get(row['id'], 0),
        )
        for row in map(dict, cursor.execute('SELECT * FROM topics ORDER BY id'))
    ]


def _ros1_file(path: Path) -> StorageFile:
    reader = rosbag1.Reader(path)
    reader.open()

    def messages(ids: Collection[int]) -> Iterator[StoredMessage]:
        chosen = [item for item in reader.connections if item.id in ids]
        for connection, stamp_ns, data in reader.messages(chosen):
            yield connection.id, stamp_ns, data

    topics = [
        StoredTopic(
            item.id,
            item.topic,
            item.msgtype,
            item.msgdef.data,
            'ros1msg',
            ROS1,
            count=item.msgcount,
        )
        for item in reader.connections
    ]
    return StorageFile(topics, reader.start_time, reader.end_time, messages, reader.close)


FILES: Mapping[str, Callable[[Path], StorageFile]] = {
    'mcap': _mcap_file,
    'sqlite3': _sqlite_file,
    containers.ROS1: _ros1_file,
}
