"""Salvage: reads what remains of a storage file that a crash cut off or a disk damaged."""

from collections.abc import Iterator
from contextlib import closing
from dataclasses import dataclass, field
from pathlib import Path
import sqlite3
import struct
from typing import BinaryIO, cast

from mcap.exceptions import EndOfFile, McapError
from mcap.records import Channel, Chunk, McapRecord, Message, Schema
from mcap.stream_reader import breakup_chunk, CRCValidationError, StreamReader
import zstandard

from visual_servo_epipolar.bags.storage import roll_back

BAD_RECORD = (McapError, CRCValidationError, struct.error, ValueError, RuntimeError)
BAD_CHUNK = (*BAD_RECORD, zstandard.ZstdError)


@dataclass(frozen=True, slots=True)
class StoredTopic:
    """Topic as a storage file describes it: QoS as YAML, hash empty where it does not say."""

    topic: str
    kind: str
    definition: str
    encoding: str
    qos: str
    type_hash: str


@dataclass(slots=True)
class Salvage:
    """Salvage of a storage file: its messages, and, once they are read, what was lost."""

    path: Path
    lost_bytes: int = field(default=0, init=False)  # could not be read
    compression: str = field(default='', init=False)  # of chunks

    def messages(self) -> Iterator[tuple[StoredTopic, int, bytes]]:
        """Yield topic, stamp and bytes of every whole message, in the order of the file."""
        yield from _mcap(self) if self.path.suffix == '.mcap' else _sqlite(self)


class _BoundedFile:
    """File that returns all the bytes asked for, or raises EndOfFile: never fewer."""

    def __init__(self, file: BinaryIO, size: int) -> None:
        self._file, self._size = file, size

    def read(self, count: int) -> bytes:
        if count > self._size - self._file.tell():
            raise EndOfFile
        return self._file.read(count)


def _mcap(salvage: Salvage) -> Iterator[tuple[StoredTopic, int, bytes]]:
    size = salvage.path.stat().st_size
    schemas: dict[int, Schema] = {}
    topics: dict[int, StoredTopic] = {}
    with salvage.path.open('rb') as file:
        for record in _records(salvage, file, size):
            if isinstance(record, Schema):
                schemas[record.id] = record
            elif isinstance(record, Channel) and record.schema_id in schemas:
                topics[record.id] = _stored_topic(record, schemas[record.schema_id])
            elif isinstance(record, Message) and record.channel_id in topics:
                yield topics[record.channel_id], record.log_time, record.data


def _records(salvage: Salvage, file: BinaryIO, size: int) -> Iterator[McapRecord]:
    """Yield the records of a file up to its end, or to where it cannot be followed any more."""
    bounded = cast(BinaryIO, _BoundedFile(file, size))
    stream = StreamReader(bounded, emit_chunks=True, record_size_limit=size)
    whole_bytes = 0
    try:
        for record in stream.records:
            if isinstance(record, Chunk):
                yield from _chunk_records(salvage, record)
            else:
                yield record
            whole_bytes = file.tell()
    except BAD_RECORD:
        salvage.lost_bytes += size - whole_bytes


def _chunk_records(salvage: Salvage, chunk: Chunk) -> list[McapRecord]:
    salvage.compression = chunk.compression
    try:
        return breakup_chunk(chunk, validate_crc=True)
    except BAD_CHUNK:
        salvage.lost_bytes += len(chunk.data)
        return []


def _stored_topic(channel: Channel, schema: Schema) -> StoredTopic:
    return StoredTopic(
        channel.topic,
        schema.name,
        schema.data.decode(),
        channel.message_encoding,
        channel.metadata.get('offered_qos_profiles', ''),
        channel.metadata.get('topic_type_hash', ''),
    )


def _sqlite(salvage: Salvage) -> Iterator[tuple[StoredTopic, int, bytes]]:
    """Yield the rows of a database as far as they can be read."""
    read = 0
    try:
        roll_back(salvage.path)
        with closing(sqlite3.connect(salvage.path)) as db:
            topics = _stored_topics(db)
            for topic, stamp_ns, data in db.execute(
                'SELECT topic_id, timestamp, data FROM messages ORDER BY id'
            ):
                if topic in topics:
                    read += len(data)
                    yield topics[topic], stamp_ns, data
    except (sqlite3.Error, TypeError):  # TypeError: a column of another type than was written
        salvage.lost_bytes += max(1, salvage.path.stat().st_size - read)


def _stored_topics(db: sqlite3.Connection) -> dict[int, StoredTopic]:
    """Return the topics of a database by their ids; older ones say less about them."""
    defined = 'encoded_message_definition' in _columns(db, 'message_definitions')
    columns = _columns(db, 'topics')
    texts = {}
    if defined:
        texts = dict(
            db.execute('SELECT topic_type, encoded_message_definition FROM message_definitions')
        )
    selected = [
        name if name in columns else "''"
        for name in ('serialization_format', 'offered_qos_profiles', 'type_description_hash')
    ]
    return {
        number: StoredTopic(name, kind, texts.get(kind, ''), encoding, qos, type_hash)
        for number, name, kind, encoding, qos, type_hash in db.execute(
            f'SELECT id, name, type, {", ".join(selected)} FROM topics ORDER BY id'
        )
    }


def _columns(db: sqlite3.Connection, table: str) -> set[str]:
    return {row[1] for row in db.execute(f'PRAGMA table_info({table})')}
