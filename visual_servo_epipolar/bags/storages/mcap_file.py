"""Files of mcap, of whatever profile and encoding, read by the library of mcap."""

from collections import Counter
from collections.abc import Collection, Iterable, Iterator, Mapping
import io
from operator import attrgetter
from pathlib import Path

from mcap.exceptions import EndOfFile, McapError
from mcap.reader import make_reader
from mcap.records import Channel, Header, McapRecord, Message, Schema
from mcap.stream_reader import StreamReader
from mcap.summary import Summary
from mcap.writer import MCAP0_MAGIC

from visual_servo_epipolar.bags.storages.stored import StorageFile, StoredMessage, StoredTopic


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


def mcap_file(path: Path) -> StorageFile:
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
    topics = _topics(summary.channels, summary.schemas, statistics.channel_message_counts)
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
    first = last = 0
    in_order = True
    for record in _records(path):
        if isinstance(record, Schema):
            schemas[record.id] = record
        elif isinstance(record, Channel):
            channels[record.id] = record
        elif isinstance(record, Message):
            if not counts:
                first = last = record.log_time
            counts[record.channel_id] += 1
            in_order = in_order and record.log_time >= last
            first, last = min(first, record.log_time), max(last, record.log_time)

    def messages(ids: Collection[int]) -> Iterator[StoredMessage]:
        records: Iterable[Message] = (
            item for item in _records(path) if isinstance(item, Message) and item.channel_id in ids
        )
        for record in records if in_order else sorted(records, key=attrgetter('log_time')):
            yield record.channel_id, record.log_time, record.data

    topics = _topics(channels, schemas, counts)
    return StorageFile(topics, first, last, messages)


def _records(path: Path) -> Iterator[McapRecord]:
    with ExactFile(path) as file:
        yield from StreamReader(file, validate_crcs=True, record_size_limit=file.size).records


def _topics(
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


def profile(path: Path) -> str:
    """Return the profile of a file; raises McapError where its header is damaged."""
    with ExactFile(path) as file:
        header = next(StreamReader(file, record_size_limit=file.size).records)
    if not isinstance(header, Header):
        raise McapError('it has no header')
    return header.profile
