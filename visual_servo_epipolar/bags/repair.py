"""
Repair: makes a damaged or unfinished bag readable, and overwrites none of its files.

What can be read of a damaged file of mcap before its damage is written beside it, as
NAME.repaired.mcap, by the library of mcap; a metadata.yaml that does not fit is set aside.
"""

from contextlib import suppress
from dataclasses import dataclass
import io
from pathlib import Path

from mcap.exceptions import EndOfFile, McapError
from mcap.reader import make_reader, NonSeekingReader
from mcap.records import Header
from mcap.writer import MCAP0_MAGIC, Writer

from visual_servo_epipolar.bags.definitions import METADATA
from visual_servo_epipolar.bags.reading.bag import (
    ADVICE,
    DAMAGE,
    EXPECTED,
    NO_DAMAGE,
    open_file,
    REPAIRED,
    storage_files,
    words_of,
)
from visual_servo_epipolar.core.errors import InputError
from visual_servo_epipolar.files import whole


@dataclass(frozen=True, slots=True)
class RepairReport:
    """Report on a repair: which bag to read, how many messages it has, and what was done."""

    path: Path
    messages: int
    notes: tuple[str, ...]

    def __str__(self) -> str:
        return '; '.join(
            [f'{self.path}: {self.messages} messages', *(self.notes or ['all whole'])]
        )


def repair(path: Path) -> RepairReport:
    """
    Make a rosbag2 folder, or one of its files, readable again; ``report.path`` is what to read.

    Every byte is read. What lies behind damage is lost.

    Raises InputError if there is no bag, no space, or a damaged file that is no mcap.
    """
    files = storage_files(path) if path.is_dir() else [path] if path.is_file() else []
    if not files:
        raise InputError(f'{path}: not a bag to repair; {EXPECTED}')
    notes: list[str] = []
    try:
        read = [_readable(file, notes) for file in files]
        messages = sum(count for _, count in read)
        if not path.is_dir():
            return RepairReport(read[0][0], messages, tuple(notes))
        _check_metadata(path, notes)
        return RepairReport(path, messages, tuple(notes))
    except DAMAGE as error:
        raise InputError(f'{path}: bag cannot be repaired: {words_of(error)}') from None


def _readable(file: Path, notes: list[str]) -> tuple[Path, int]:
    """Return a file that can be read, the remains of ``file`` if need be, and its messages."""
    try:
        return file, _count(file)
    except DAMAGE as error:
        if isinstance(error, OSError) and error.errno in NO_DAMAGE:
            raise
        if file.suffix != '.mcap':
            raise InputError(
                f'{file}: it stays as it is: {words_of(error)}; '
                f'{ADVICE[file.suffix].format(name=file.name)}'
            ) from None
    target = file.with_name(f'{file.stem}{REPAIRED}')
    end = ''
    if not target.exists():
        with whole(target) as partial:
            end = _copy_messages(file, partial)
    elif target.stat().st_mtime_ns < file.stat().st_mtime_ns:
        raise InputError(f'{target} is older than {file.name}; give it another name')
    count = _count(target)
    notes.append(f'{target.name} holds {count} messages of {file.name}{end}')
    return target, count


def _count(file: Path) -> int:
    """Read a file to its end, and return its messages; raises one of DAMAGE if it is not whole."""
    if file.suffix != '.mcap':
        with open_file(file) as reader:
            return sum(1 for _ in reader.messages())
    with ExactFile(file) as stream:
        summary = make_reader(stream).get_summary()  # raises if the end is missing
        stream.seek(0)
        messages = NonSeekingReader(stream, validate_crcs=True).iter_messages(log_time_order=False)
        count = sum(1 for _ in messages)
    statistics = None if summary is None else summary.statistics
    if statistics is not None and statistics.message_count != count:
        raise McapError('its index is wrong')
    return count


def _copy_messages(file: Path, target: Path) -> str:
    """Write the messages of a file of mcap to a new one; return where it is damaged, and how."""
    channels: dict[int, int] = {}
    end, header = '', Header('ros2', '')
    with suppress(*DAMAGE), ExactFile(file) as source:
        header = make_reader(source).get_header()
    with ExactFile(file) as source, target.open('wb') as output:
        writer = Writer(output)
        writer.start(header.profile, header.library)
        reader = NonSeekingReader(source, validate_crcs=True, record_size_limit=None)
        try:
            for schema, channel, message in reader.iter_messages(log_time_order=False):
                if channel.id not in channels:
                    number = (
                        writer.register_schema(schema.name, schema.encoding, schema.data)
                        if schema
                        else 0
                    )
                    channels[channel.id] = writer.register_channel(
                        channel.topic, channel.message_encoding, number, channel.metadata
                    )
                writer.add_message(
                    channels[channel.id],
                    message.log_time,
                    message.data,
                    message.publish_time,
                    message.sequence,
                )
        except DAMAGE as error:
            if isinstance(error, OSError) and error.errno is not None:  # of the disk
                raise
            end = (
                f', which is damaged at byte {source.tell()} of {source.size} '
                f'({words_of(error)}): what lies behind is lost'
            )
        writer.finish()
    with file.open('rb') as begin:
        is_mcap = begin.read(len(MCAP0_MAGIC)) == MCAP0_MAGIC
    if not (channels or is_mcap):
        raise InputError(f'{file}: nothing of it can be read; it stays as it is')
    return end


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


def _check_metadata(folder: Path, notes: list[str]) -> None:
    """Set a metadata.yaml aside that is broken, or of other files."""
    metadata = folder / METADATA
    if not metadata.is_file():
        return
    try:
        with open_file(folder):
            return
    except DAMAGE as error:
        kept = folder / f'{METADATA}.damaged'
        if kept.exists():
            raise InputError(f'{kept} is there already; give it another name') from None
        metadata.rename(kept)
        notes.append(
            f'metadata.yaml is now {kept.name} ({words_of(error)}); for other tools write a new '
            f'one with "ros2 bag reindex {folder}"'
        )
