"""Repair: completes a bag that is damaged or was left open; all that is whole is kept."""

from contextlib import closing, suppress
from dataclasses import dataclass
import os
from pathlib import Path
import re
import shutil
import sqlite3
from tempfile import TemporaryDirectory

from mcap.reader import make_reader
from rosbags.interfaces import Connection
from rosbags.rosbag2 import CompressionFormat, CompressionMode, Reader, Writer, WriterError
from rosbags.rosbag2.metadata import parse_qos

from visual_servo_epipolar.bags import metadata
from visual_servo_epipolar.bags.definitions import hash_of
from visual_servo_epipolar.bags.metadata import PartInfo, SUFFIXES, VERSION
from visual_servo_epipolar.bags.reading.bag import DAMAGE
from visual_servo_epipolar.bags.salvage import Salvage, StoredTopic
from visual_servo_epipolar.bags.storage import close_writer, PLUGINS
from visual_servo_epipolar.core.errors import InputError

STORAGES = {suffix: storage for storage, suffix in SUFFIXES.items()}
ZSTD_MAGIC = b'\x28\xb5\x2f\xfd'  # no serialized message begins like this
SCRATCH = '.repair_'


@dataclass(frozen=True, slots=True)
class RepairReport:
    """Report on a repair: what is in the bag, and what was rewritten."""

    path: Path
    messages: int
    files: int
    rewritten: tuple[str, ...]  # names of the files that were not whole
    lost_bytes: int  # of those, what could not be read
    described: bool  # whether metadata.yaml was written
    lost: tuple[str, ...] = ()  # names of files that are not there any more

    def __str__(self) -> str:
        text = f'{self.path}: {self.messages} messages in {self.files} files'
        if self.rewritten:
            text += (
                f'; completed {", ".join(self.rewritten)}, {self.lost_bytes} bytes could not be '
                'read'
            )
        else:
            text += ', all whole' + (', metadata.yaml completed' if self.described else '')
        return text + (f'; lost: {", ".join(self.lost)}' if self.lost else '')


@dataclass(frozen=True, slots=True)
class _RepairedFile:
    """Repaired storage file: what it holds, and what the repair did."""

    info: PartInfo
    rewritten: bool
    lost_bytes: int
    compressed: bool  # message by message


def repair(path: Path) -> RepairReport:
    """
    Make a rosbag2 folder, or one of its .mcap or .db3 files, readable again.

    Every byte is read. Files that are whole stay as they are; what remains of the others is
    written anew, with an index, and takes their place only when it is complete: that needs as
    much free space. A metadata.yaml that is missing or broken is written anew, and one that lists
    files that are lost.

    Raises
    ------
    InputError
        If there is nothing to repair, or no space to do it in.

    """
    files = _storage_files(path)
    folder = path if path.is_dir() else path.parent
    lost = _lost_files(folder, files) if path.is_dir() else ()
    try:
        for stale in folder.glob(f'{SCRATCH}*'):
            shutil.rmtree(stale)
        with TemporaryDirectory(dir=folder, prefix=SCRATCH) as scratch:
            parts = [_repair_file(file, folder, Path(scratch)) for file in files]
        described = path.is_dir() and _describe(folder, parts)
    except (*DAMAGE, WriterError) as error:
        message = getattr(error, 'strerror', None) or error
        raise InputError(f'{path}: bag cannot be repaired: {message}; nothing was lost') from None
    return RepairReport(
        path,
        sum(part.info.count for part in parts),
        len(parts),
        tuple(part.info.file for part in parts if part.rewritten),
        sum(part.lost_bytes for part in parts),
        described,
        lost,
    )


def _storage_files(path: Path) -> list[Path]:
    """Return the storage files of a bag in their order; one being recorded has its own folder."""
    if path.is_dir():
        files = [
            item
            for pattern in ('*', '*/*')
            for item in path.glob(pattern)
            if item.suffix in STORAGES and not item.parent.name.startswith(SCRATCH)
        ]
    else:
        files = [path] if path.is_file() and path.suffix in STORAGES else []
    if not files or len({item.suffix for item in files}) > 1:
        raise InputError(
            f'{path}: not a bag to repair; give a rosbag2 folder with .mcap or .db3 files, or '
            'one of these'
        )
    return sorted(files, key=_number)


def _number(path: Path) -> tuple[int, str]:
    digits = re.search(r'(\d{1,9})$', path.stem)
    return (int(digits[1]) if digits else 0, path.name)


def _lost_files(folder: Path, files: list[Path]) -> tuple[str, ...]:
    """Return the names of files that are lost: by metadata.yaml, or by a gap in the numbers."""
    names = [file.name for file in files]
    expected = metadata.listed_files(folder)
    if expected is None:
        expected = _numbered_like(files[-1])
    return tuple(name for name in expected if name not in names)


def _numbered_like(last: Path) -> list[str]:
    """Return the names of the files of a recording up to its last one, all that it ever had."""
    name = re.fullmatch(r'(.*_)(\d{1,4})', last.stem)
    if name is None:
        return []
    return [f'{name[1]}{number}{last.suffix}' for number in range(int(name[2]))]


def _repair_file(file: Path, folder: Path, scratch: Path) -> _RepairedFile:
    """Bring one file to its destination, written anew if it is not whole."""
    salvage, destination = Salvage(file), folder / file.name
    compressed = False
    for _, _, data in salvage.messages():
        compressed = compressed or data[:4] == ZSTD_MAGIC
    whole = not salvage.lost_bytes and _is_intact(file)
    os.replace(file if whole else _rewritten(salvage, scratch), destination)
    if file.parent != folder:
        shutil.rmtree(file.parent)
    return _RepairedFile(_info(destination), not whole, salvage.lost_bytes, compressed)


def _is_intact(file: Path) -> bool:
    """Return whether a file can be read by readers that seek in it."""
    with suppress(*DAMAGE, sqlite3.Error):
        with Reader(file):
            pass
        if file.suffix == '.mcap':
            with file.open('rb') as stream:
                return make_reader(stream).get_summary() is not None
        with closing(sqlite3.connect(file)) as db:
            return bool(db.execute('PRAGMA quick_check').fetchall() == [('ok',)])
    return False


def _rewritten(salvage: Salvage, scratch: Path) -> Path:
    """Write all that remains of a file to a new one, and return its path."""
    suffix = salvage.path.suffix
    second_pass = Salvage(salvage.path)
    writer = Writer(
        scratch / salvage.path.stem, version=VERSION, storage_plugin=PLUGINS[STORAGES[suffix]]
    )
    if salvage.compression:
        writer.set_compression(CompressionMode.STORAGE, CompressionFormat.ZSTD)
    connections: dict[StoredTopic, Connection] = {}
    writer.open()
    try:
        for topic, stamp_ns, data in second_pass.messages():
            if topic not in connections:
                connections[topic] = _connection(writer, topic)
            writer.write(connections[topic], stamp_ns, data)
        close_writer(writer)
    except BaseException:
        writer.abort()
        raise
    return writer.path / f'{writer.path.name}{suffix}'


def _connection(writer: Writer, topic: StoredTopic) -> Connection:
    return writer.add_connection(
        topic.topic,
        topic.kind,
        msgdef=topic.definition,
        rihs01=topic.type_hash or hash_of(topic.kind, topic.definition) or 'unknown',
        serialization_format=topic.encoding or 'cdr',
        offered_qos_profiles=parse_qos(topic.qos),
    )


def _info(file: Path) -> PartInfo:
    with Reader(file) as reader:
        connections = tuple(
            item._replace(digest=item.digest or hash_of(item.msgtype, item.msgdef.data))
            for item in reader.connections
        )
        counts = {item.id: item.msgcount for item in connections}
        return PartInfo(file.name, connections, counts, reader.start_time, reader.end_time - 1)


def _describe(folder: Path, parts: list[_RepairedFile]) -> bool:
    """Write metadata.yaml where it is missing, broken or out of date."""
    if not any(part.rewritten for part in parts) and _is_described(folder):
        return False
    storage = STORAGES[Path(parts[0].info.file).suffix]
    mode = 'message' if any(part.compressed for part in parts) else ''
    metadata.write(folder, metadata.document([part.info for part in parts], storage, mode))
    return True


def _is_described(folder: Path) -> bool:
    """Return whether metadata.yaml is there, can be read, and lists files that are there."""
    with suppress(*DAMAGE), Reader(folder):
        return True
    return False
