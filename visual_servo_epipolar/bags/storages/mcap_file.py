"""Files of mcap, of whatever profile and encoding, read by the library of mcap."""

from collections import Counter
from collections.abc import Collection, Iterable, Iterator, Sequence
from dataclasses import dataclass, field
import io
from operator import attrgetter
from pathlib import Path

from mcap.exceptions import EndOfFile, McapError
from mcap.reader import make_reader
from mcap.records import Channel, Header, McapRecord, Message, Schema
from mcap.stream_reader import StreamReader
from mcap.summary import Summary
from mcap.writer import MCAP0_MAGIC

from visual_servo_epipolar.bags.storages.stored import StoredMessage, StoredTopic


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


class McapFile:
    """File of mcap: read by its index, or from its beginning where it has none."""

    def __init__(self, path: Path) -> None:
        self._path = path
        with ExactFile(path) as file:
            file.seek(-min(file.size, len(MCAP0_MAGIC)), io.SEEK_END)
            if file.read(len(MCAP0_MAGIC)) != MCAP0_MAGIC:
                raise McapError('its end is missing')
            file.seek(0)
            summary = make_reader(file).get_summary()
        self._indexed = summary is not None and _is_index(summary)
        content = _Content()
        if summary is not None and self._indexed:
            content.take(summary)
        else:
            for record in self._records():
                content.add(record)
        self._in_order = content.in_order
        self.start_ns, self.end_ns = content.start_ns or 0, content.end_ns
        self.topics: Sequence[StoredTopic] = [
            stored_channel(
                item, content.schemas.get(item.schema_id), content.counts.get(item.id, 0)
            )
            for item in content.channels.values()
        ]

    def __enter__(self) -> 'McapFile':
        return self

    def __exit__(self, *_: object) -> None:
        """Each reading opens the file by itself."""

    def messages(self, ids: Collection[int]) -> Iterator[StoredMessage]:
        """Yield the messages of some topics in the order of time."""
        records: Iterable[Message] = (
            item
            for item in self._records()
            if isinstance(item, Message) and item.channel_id in ids
        )
        if self._indexed:
            records = self._by_index(ids)
        elif not self._in_order:
            records = sorted(records, key=attrgetter('log_time'))
        for record in records:
            if record.channel_id in ids:
                yield record.channel_id, record.log_time, record.data

    def _by_index(self, ids: Collection[int]) -> Iterator[Message]:
        names = {item.topic for item in self.topics if item.id in ids}
        with ExactFile(self._path) as file:
            for _, _, message in make_reader(file, validate_crcs=True).iter_messages(names):
                yield message

    def _records(self) -> Iterator[McapRecord]:
        with ExactFile(self._path) as file:
            yield from StreamReader(file, validate_crcs=True, record_size_limit=file.size).records


def stored_channel(channel: Channel, schema: Schema | None, count: int) -> StoredTopic:
    """Return the topic of a channel; without a schema it has no type."""
    return StoredTopic(
        channel.id,
        channel.topic,
        '' if schema is None else schema.name,
        '' if schema is None else schema.data.decode(errors='replace'),
        '' if schema is None else schema.encoding,
        channel.message_encoding,
        channel.metadata.get('offered_qos_profiles', ''),
        channel.metadata.get('topic_type_hash', ''),
        count,
    )


def profile(path: Path) -> str:
    """Return the profile of a file; raises McapError where its header is damaged."""
    with ExactFile(path) as file:
        header = next(StreamReader(file, record_size_limit=file.size).records)
    if not isinstance(header, Header):
        raise McapError('it has no header')
    return header.profile


def _is_index(summary: Summary) -> bool:
    """Return whether messages can be found by a summary; each part of one is optional."""
    return (
        summary.statistics is not None
        and len(summary.channels) == summary.statistics.channel_count
        and {item.schema_id for item in summary.channels.values()} <= {0, *summary.schemas}
        and bool(summary.chunk_indexes)
        and all(item.message_index_offsets for item in summary.chunk_indexes)
    )


@dataclass(slots=True)
class _Content:
    """Content of a file: by its summary, or by its records."""

    schemas: dict[int, Schema] = field(default_factory=dict)
    channels: dict[int, Channel] = field(default_factory=dict)
    counts: Counter[int] = field(default_factory=Counter)
    start_ns: int | None = None
    end_ns: int = 0
    in_order: bool = True

    def take(self, summary: Summary) -> None:
        statistics = summary.statistics
        assert statistics is not None
        self.schemas, self.channels = summary.schemas, summary.channels
        self.counts.update(statistics.channel_message_counts)
        if statistics.message_count:
            self.start_ns, self.end_ns = (
                statistics.message_start_time,
                statistics.message_end_time,
            )

    def add(self, record: McapRecord) -> None:
        if isinstance(record, Schema):
            self.schemas[record.id] = record
        elif isinstance(record, Channel):
            self.channels[record.id] = record
        elif isinstance(record, Message):
            self.counts[record.channel_id] += 1
            stamp_ns = record.log_time
            self.in_order = self.in_order and stamp_ns >= self.end_ns
            self.start_ns = stamp_ns if self.start_ns is None else min(self.start_ns, stamp_ns)
            self.end_ns = max(self.end_ns, stamp_ns)
