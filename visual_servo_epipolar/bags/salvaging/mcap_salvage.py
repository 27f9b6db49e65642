"""Salvage of mcap: all that is left of a file, counted, and written to a new one."""

from collections import Counter
from collections.abc import Iterator
from pathlib import Path

from mcap.records import Attachment, Channel, Header, McapRecord, Message, Metadata, Schema
from mcap.writer import CompressionType, Writer

from visual_servo_epipolar.bags.salvaging.mcap_records import LeftRecords

COMPRESSIONS = {
    '': CompressionType.NONE,
    'lz4': CompressionType.LZ4,
    'zstd': CompressionType.ZSTD,
}
Key = tuple[str, str, str]  # topic, encoding of its messages, type


class McapSalvage:
    """Salvage of an mcap file; ``counts`` by channel are true once its records are read."""

    def __init__(self, path: Path) -> None:
        self.path = path
        self._begin()

    def _begin(self) -> None:
        self._left = LeftRecords(self.path)
        self.header, self._has_header = Header('ros2', ''), False
        self.counts: Counter[Key] = Counter()
        # A chunk that is damaged may have held what others need: the summary repeats it.
        summary = self._left.summary
        self.schemas = {} if summary is None else dict(summary.schemas)
        self.channels = {} if summary is None else dict(summary.channels)

    def is_sound(self) -> bool:
        """Read it all; return whether all is as it was written, footer and summary too."""
        for _ in self.records():
            pass
        return not self.lost_bytes and self._has_header and self._left.summary is not None

    @property
    def lost_bytes(self) -> int:
        """Bytes that could not be read."""
        return self._left.lost_bytes

    def losses(self) -> list[str]:
        """Say what of it a new file does not have, where the summary tells how much there was."""
        counts: Counter[Key] = Counter()
        if self._left.summary is not None and self._left.summary.statistics is not None:
            for number, count in self._left.summary.statistics.channel_message_counts.items():
                if number in self.channels:
                    counts[self._key(number)] += count
        lost = counts - self.counts
        words = [f'{key[0]} {count} of {counts[key]} messages' for key, count in lost.items()]
        if self._left.private:
            words.append(f'{self._left.private} private records, which the old file alone has')
        return words

    def records(self) -> Iterator[McapRecord]:
        """Yield all that was recorded, in the order of the file."""
        self._begin()
        for record in self._left:
            if isinstance(record, Header):
                self.header, self._has_header = record, True
            elif isinstance(record, Schema):
                self.schemas[record.id] = record
            elif isinstance(record, Channel):
                self.channels[record.id] = record
            elif isinstance(record, Message):
                if record.channel_id not in self.channels:
                    self._left.lost_bytes += len(record.data)
                    continue
                self.counts[self._key(record.channel_id)] += 1
            else:
                self.counts['', '', type(record).__name__] += 1
            yield record

    def write(self, target: Path) -> None:
        """Write all that is left, once it was read, to a new file with an index."""
        compression, header = COMPRESSIONS[self._left.compression], self.header
        with target.open('xb') as file:
            writer = Writer(file, compression=compression)
            writer.start(header.profile, header.library)
            channels = _Channels(writer, self)
            for record in self.records():
                if isinstance(record, Message):
                    number = channels.number(self.channels[record.channel_id])
                    writer.add_message(
                        number, record.log_time, record.data, record.publish_time, record.sequence
                    )
                elif isinstance(record, Attachment):
                    writer.add_attachment(
                        record.create_time,
                        record.log_time,
                        record.name,
                        record.media_type,
                        record.data,
                    )
                elif isinstance(record, Metadata):
                    writer.add_metadata(record.name, record.metadata)
            for channel in self.channels.values():  # those without messages, too
                channels.number(channel)
            for schema in self.schemas.values():
                channels.schema_number(schema)
            writer.finish()

    def _key(self, number: int) -> Key:
        channel = self.channels[number]
        schema = self.schemas.get(channel.schema_id)
        return channel.topic, channel.message_encoding, '' if schema is None else schema.name


class _Channels:
    """Channels of a new file: each is added when its first message is."""

    def __init__(self, writer: Writer, salvage: McapSalvage) -> None:
        self._writer, self._salvage = writer, salvage
        self._numbers: dict[bytes, int] = {}
        self._schemas: dict[tuple[str, str, bytes], int] = {}

    def number(self, channel: Channel) -> int:
        schema = self._salvage.schemas.get(channel.schema_id)
        key = repr((channel, schema)).encode()
        if key not in self._numbers:
            self._numbers[key] = self._writer.register_channel(
                channel.topic,
                channel.message_encoding,
                0 if schema is None else self.schema_number(schema),
                channel.metadata,
            )
        return self._numbers[key]

    def schema_number(self, schema: Schema) -> int:
        key = schema.name, schema.encoding, schema.data
        if key not in self._schemas:
            self._schemas[key] = self._writer.register_schema(*key)
        return self._schemas[key]
