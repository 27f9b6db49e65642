"""Records of a file of mcap, as far as a crash or a disk has left them whole."""

from bisect import bisect_right
from collections.abc import Callable, Iterator, Mapping
from contextlib import suppress
from io import BytesIO
from pathlib import Path
import struct
import zlib

import lz4.frame  # type: ignore[import-untyped]
from mcap.data_stream import ReadDataStream
from mcap.exceptions import EndOfFile, McapError
from mcap.opcode import Opcode
from mcap.reader import make_reader
from mcap.records import Attachment, Channel, Chunk, Header, McapRecord, Message, Metadata, Schema
from mcap.summary import Summary
from mcap.writer import MCAP0_MAGIC
import zstandard

from visual_servo_epipolar.bags.storages.mcap_file import ExactFile

BAD_RECORD = (McapError, struct.error, ValueError, RuntimeError, MemoryError, OverflowError)
BAD_FILE = (*BAD_RECORD, LookupError, OSError)
BAD_CHUNK = (*BAD_RECORD, zstandard.ZstdError)
LARGEST = 2**30  # no recorder writes a chunk of more bytes
PRIVATE = 0x80  # from here on opcodes are anybody's
START = struct.Struct('<BQ')  # of a record: opcode, length
PARSERS: Mapping[int, Callable[[ReadDataStream, int], McapRecord]] = {
    Opcode.HEADER: lambda stream, _: Header.read(stream),
    Opcode.SCHEMA: lambda stream, _: Schema.read(stream),
    Opcode.CHANNEL: lambda stream, _: Channel.read(stream),
    Opcode.MESSAGE: Message.read,
    Opcode.CHUNK: lambda stream, _: Chunk.read(stream),
    Opcode.ATTACHMENT: lambda stream, _: Attachment.read(stream),
    Opcode.METADATA: lambda stream, _: Metadata.read(stream),
}


class LeftRecords:
    """Records that are left of a file; what it says of them is true once they are read."""

    def __init__(self, path: Path) -> None:
        self._path = path
        self.summary = _summary(path)
        self._known = _offsets(self.summary)
        self.lost_bytes = 0
        self.private = 0  # records that only their writer understands
        self.compression = ''  # of chunks

    def __iter__(self) -> Iterator[McapRecord]:
        """Yield records; from where they cannot be followed go on where the summary knows one."""
        with ExactFile(self._path) as file:
            at = len(MCAP0_MAGIC)
            if file.peek(at)[:at] != MCAP0_MAGIC:
                self.lost_bytes += min(at, file.size)
            while at < file.size:
                file.seek(at)
                start = file.read(min(START.size, file.size - at))
                opcode, length = START.unpack(start) if len(start) == START.size else (0, 0)
                end = at + START.size + length
                if opcode == Opcode.FOOTER and end == file.size - len(MCAP0_MAGIC):
                    return
                following = self._following(at, file.size)
                is_known = opcode in tuple(Opcode) or opcode >= PRIVATE
                if is_known and end <= following:
                    yield from self._parse(opcode, file.read(length))
                    at = end
                    continue
                if opcode == Opcode.CHUNK and following == file.size:
                    yield from self._cut_chunk(file.read(min(LARGEST, file.size - file.tell())))
                elif is_known and following < file.size:  # its length alone is damaged
                    self.lost_bytes += START.size
                    yield from self._parse(opcode, file.read(following - file.tell()))
                else:
                    self.lost_bytes += following - at
                at = following

    def _following(self, at: int, size: int) -> int:
        """Return where the next record that the summary knows begins, or the end."""
        number = bisect_right(self._known, at)
        return min(size, self._known[number]) if number < len(self._known) else size

    def _parse(self, opcode: int, data: bytes) -> Iterator[McapRecord]:
        if opcode >= PRIVATE:
            self.private += 1
            return
        if opcode not in PARSERS:  # an index, which is made anew
            return
        try:
            record = PARSERS[opcode](_ExactStream(BytesIO(data)), len(data))
            if isinstance(record, Attachment):
                _check(data[:-4], int.from_bytes(data[-4:], 'little'))
            if not isinstance(record, Chunk):
                yield record
                return
            content = _content(record)
        except BAD_CHUNK:
            self.lost_bytes += START.size + len(data)
            return
        self.compression = record.compression
        yield from self._chunk_records(content)

    def _cut_chunk(self, data: bytes) -> Iterator[McapRecord]:
        """Yield what is whole of a chunk that the end of the file cuts off."""
        content = b''
        with suppress(*BAD_CHUNK):
            name_length = int.from_bytes(data[28:32], 'little')
            compression = data[32 : 32 + name_length].decode()
            content = _decompress_beginning(compression, data[32 + name_length + 8 :])
            self.compression = compression
        lost_bytes = self.lost_bytes
        yield from self._chunk_records(content)
        self.lost_bytes = max(self.lost_bytes, lost_bytes + 1)

    def _chunk_records(self, content: bytes) -> Iterator[McapRecord]:
        at = 0
        while at < len(content):
            opcode, length = 0, len(content)
            if at + START.size <= len(content):
                opcode, length = START.unpack_from(content, at)
            end = at + START.size + length
            if end > len(content):
                self.lost_bytes += len(content) - at
                return
            yield from self._parse(opcode, content[at + START.size : end])
            at = end


class _ExactStream(ReadDataStream):
    """Stream of a record that raises EndOfFile rather than to return fewer bytes."""

    def read(self, length: int) -> bytes:
        data: bytes = super().read(length)
        if len(data) != length:
            raise EndOfFile
        return data


def _summary(path: Path) -> Summary | None:
    """Return the summary of a file, None where it has none or it is damaged."""
    with suppress(*BAD_FILE), ExactFile(path) as file:
        return make_reader(file).get_summary()
    return None


def _offsets(summary: Summary | None) -> list[int]:
    """Return where the records that a summary knows begin, in order."""
    if summary is None:
        return []
    known = [item.chunk_start_offset for item in summary.chunk_indexes]
    known += [item.offset for item in summary.attachment_indexes]
    known += [item.offset for item in summary.metadata_indexes]
    return sorted(known)


def _content(chunk: Chunk) -> bytes:
    """Return what a chunk holds; raises one of BAD_CHUNK where it is damaged."""
    content = _decompress_beginning(chunk.compression, chunk.data)
    if len(content) != chunk.uncompressed_size:
        raise EndOfFile
    _check(content, chunk.uncompressed_crc)
    return content


def _decompress_beginning(compression: str, data: bytes) -> bytes:
    """Return what the beginning of a chunk holds, as far as it goes."""
    if compression == 'zstd':
        return zstandard.ZstdDecompressor().decompressobj().decompress(data)
    if compression == 'lz4':
        return bytes(lz4.frame.LZ4FrameDecompressor().decompress(data))
    if compression:
        raise McapError(f'chunks are compressed by {compression}')
    return data


def _check(data: bytes, crc: int) -> None:
    if crc and zlib.crc32(data) != crc:
        raise McapError('its checksum is wrong')
