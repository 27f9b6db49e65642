"""
Repair: makes a damaged or unfinished bag readable, and overwrites none of its files.

A file of mcap that is not whole stays as it is. What can be read of it before its damage is
written beside it, as NAME.repaired.mcap, by the library of mcap.
"""

from collections import Counter
from collections.abc import Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from pathlib import Path
import re

from mcap.exceptions import McapError
from mcap.reader import make_reader, NonSeekingReader
from mcap.records import Header
from mcap.writer import Writer

from visual_servo_epipolar.bags import containers, metadata
from visual_servo_epipolar.bags.containers import ZSTD_MAGIC
from visual_servo_epipolar.bags.definitions import hash_of
from visual_servo_epipolar.bags.metadata import PartInfo, qos_profiles, Topic
from visual_servo_epipolar.bags.reading.bag import (
    advice,
    DAMAGE,
    NO_DAMAGE,
    OTHER_ADVICE,
    words_of,
)
from visual_servo_epipolar.bags.storages import (
    ExactFile,
    journals,
    kind_of,
    open_storage,
    StoredTopic,
)
from visual_servo_epipolar.core.errors import InputError
from visual_servo_epipolar.files import whole


@dataclass(frozen=True, slots=True)
class RepairedPart:
    """Storage file that can be read: what it holds, and of which file it is the remains."""

    info: PartInfo
    storage: str
    compression: str  # none, message or file, as in metadata.yaml
    remains: str = ''  # a sentence, where the file was not whole


@dataclass(frozen=True, slots=True)
class RepairReport:
    """Report on a repair: which bag to read, what is in it, and what was done."""

    path: Path
    parts: tuple[RepairedPart, ...]
    described: bool = False  # whether metadata.yaml was written
    lost: tuple[str, ...] = ()  # names of files that are not there any more

    @property
    def messages(self) -> int:
        """Number of messages that can be read."""
        return sum(part.info.count for part in self.parts)

    def __str__(self) -> str:
        remains = [part.remains for part in self.parts if part.remains]
        return '; '.join(
            [
                f'{self.path}: {self.messages} messages in {len(self.parts)} files',
                *(remains or ['all whole']),
                *(['metadata.yaml written'] if self.described else []),
                *([f'lost: {", ".join(self.lost)}'] if self.lost else []),
            ]
        )


def repair(path: Path) -> RepairReport:
    """
    Make a rosbag2 folder, or one of its files, readable again; ``report.path`` is what to read.

    Every byte is read. What can be read of a damaged file of mcap is written to another one beside
    it, up to the damage: what lies behind is lost. A metadata.yaml that is missing, broken or of
    other files is written anew; the former one is kept as metadata.yaml.damaged.

    Raises InputError if there is no bag, no space, or a damaged file that is no mcap.
    """
    path = containers.bag_path(path)
    try:
        files = _files_of(path)
        if not path.is_dir():
            part = _part(path, path.parent)
            return RepairReport(path.with_name(part.info.file), (part,))
        lost = _lost_files(path, files)
        parts = tuple(_part(file, path) for file in files)
        return RepairReport(path, parts, _describe(path, parts), lost)
    except DAMAGE as error:
        raise InputError(f'{path}: bag cannot be repaired: {words_of(error)}') from None


def _files_of(path: Path) -> list[Path]:
    """Return the storage files of a bag in their order; one may be in a folder of its own."""
    if path.is_dir():
        files = [*containers.storage_files(path), *containers.left_open(path)]
    else:
        files = [path] if path.is_file() else []
    kinds = {containers.container(file) for file in files}
    if containers.ROS1 in kinds:
        raise InputError(
            f'{path}: a bag of ROS 1, which stays as it is; try "rosbag reindex" of ROS 1'
        )
    if len(kinds) != 1:
        what = containers.something_else(path) if path.is_dir() else ''
        raise InputError(
            f'{path}: not a bag to repair{what}; give a rosbag2 folder with .mcap or .db3 files, '
            'or one of these'
        )
    return sorted(files, key=containers.part_number)


def _lost_files(folder: Path, files: list[Path]) -> tuple[str, ...]:
    """Return the names of files that are lost: by metadata.yaml, or by a gap in the numbers."""
    names = [file.name for file in files]
    expected = metadata.listed_files(folder)
    if expected is None:
        last = re.fullmatch(r'(.*_)(\d{1,4})', files[-1].stem)  # all up to it were there
        numbered = [f'{last[1]}{k}{files[-1].suffix}' for k in range(int(last[2]))] if last else []
        return tuple(item for item in numbered if item not in names)
    missing = [name for name in expected if name not in names]
    renamed = [name for name in names if name not in expected]
    return tuple(missing) if len(renamed) < len(missing) else ()


def _part(file: Path, folder: Path) -> RepairedPart:
    """Return a file that is whole, or the remains of it, brought to ``folder``."""
    try:
        part = _read(file)
    except DAMAGE as error:
        if isinstance(error, OSError) and error.errno in NO_DAMAGE:
            raise
        return _remains(file, folder / containers.repaired_name(file), words_of(error))
    if file.parent != folder:  # where an earlier recorder was killed
        for item in (*journals(file), file):
            item.rename(folder / item.name)
    return part


def _read(file: Path) -> RepairedPart:
    """Read a file to its end; raises one of DAMAGE where it is not whole."""
    counts: Counter[str] = Counter()
    with containers.unpack(file) as plain, open_storage(plain) as stored:
        topics = {item.id: item for item in stored.topics}
        compression = '' if plain == file else 'file'
        for number, _, data in stored.messages(topics.keys()):
            counts[topics[number].topic] += 1
            if not compression and data.startswith(ZSTD_MAGIC):
                compression = 'message'
        if counts.total() != sum(item.count for item in stored.topics):
            raise McapError('its index is wrong')
        about = tuple(map(_topic, stored.topics))
        info = PartInfo(file.name, about, counts, stored.start_ns, stored.end_ns)
        return RepairedPart(info, containers.container(plain), compression)


def _topic(item: StoredTopic) -> Topic:
    is_defined = item.schema == 'ros2msg' and item.definition
    digest = item.type_hash or (hash_of(kind_of(item), item.definition) if is_defined else '')
    return Topic(item.topic, kind_of(item), digest, qos_profiles(item.qos), item.encoding)


def _remains(file: Path, target: Path, reason: str) -> RepairedPart:
    """Write what can be read of a damaged file of mcap to ``target``, and read that."""
    if containers.container(file) in OTHER_ADVICE:
        raise InputError(f'{file}: it stays as it is: {reason}; {advice(file)}')
    if target.exists():  # of an earlier repair
        if target.stat().st_mtime_ns < file.stat().st_mtime_ns:
            raise InputError(f'{target} is older than {file.name}; give it another name')
        return _read(target)
    with whole(target) as partial:
        end = _copy_messages(file, partial)
    part = _read(target)
    of = ''
    with suppress(*DAMAGE), ExactFile(file) as stream:
        summary = make_reader(stream).get_summary()
        if summary is not None and summary.statistics is not None:
            of = f' of {summary.statistics.message_count}'
    damage = f'damaged {end}: what lies behind is lost' if end else 'whole but for its index'
    remains = (
        f'{target.name} holds {part.info.count}{of} messages of {file.name}, which is {damage}'
    )
    return replace(part, remains=remains)


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
        messages = reader.iter_messages(log_time_order=False)
        while True:
            try:
                schema, channel, message = next(messages)
            except StopIteration:
                break
            except DAMAGE as error:
                end = f'at byte {source.tell()} of {source.size} ({words_of(error)})'
                break
            if channel.id not in channels:
                channels[channel.id] = writer.register_channel(
                    channel.topic,
                    channel.message_encoding,
                    writer.register_schema(schema.name, schema.encoding, schema.data)
                    if schema
                    else 0,
                    channel.metadata,
                )
            number = channels[channel.id]
            writer.add_message(
                number, message.log_time, message.data, message.publish_time, message.sequence
            )
        writer.finish()
    if not channels and containers.by_magic(file) != 'mcap':
        raise InputError(f'{file}: not a bag, and nothing of it can be read; it stays as it is')
    return end


def _describe(folder: Path, parts: Sequence[RepairedPart]) -> bool:
    """Write metadata.yaml where it is missing, broken or of other files; the old one is kept."""
    names, storage = [part.info.file for part in parts], parts[0].storage
    former = metadata.information(folder) or {}
    if (
        former.keys() >= metadata.NEEDED
        and former['storage_identifier'] == storage
        and sorted(metadata.listed_files(folder) or ()) == sorted(names)
    ):
        return False
    mode = next((part.compression for part in parts if part.compression), '')
    content = metadata.described([part.info for part in parts], storage, mode)
    # What the files do not say.
    content |= {name: former[name] for name in ('custom_data', 'ros_distro') if former.get(name)}
    file = folder / metadata.FILE
    if file.is_file() and file.stat().st_size:
        endings = ['', *(f'.{number}' for number in range(1, 1000))]
        kept = (file.with_name(f'{file.name}{it}{containers.OLD}') for it in endings)
        next(item for item in kept if not item.exists()).write_bytes(file.read_bytes())
    metadata.write(folder, content)
    return True
