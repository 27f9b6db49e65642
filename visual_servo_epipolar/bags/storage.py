"""
Storage file of a bag, written through rosbags so that a crash loses little.

rosbags keeps small messages in memory until a chunk of mcap is full (1 MiB), or until the end in
one transaction of sqlite3. To bring them to the disk in between, and to end a file on a full disk,
the storage below its ``Writer`` must be reached (``close_chunk``, ``bio``, ``conn``). rosbags
promises nothing about those, hence the bounds on its version in setup.py.
"""

from contextlib import closing, suppress
from dataclasses import dataclass
import os
from pathlib import Path
import shutil
import sqlite3
from typing import Any

from mcap.data_stream import RecordBuilder
from mcap.records import DataEnd, Footer
from mcap.writer import MCAP0_MAGIC
from rosbags.interfaces import Connection, Qos
from rosbags.rosbag2 import CompressionFormat, CompressionMode, StoragePlugin, Writer, WriterError

from visual_servo_epipolar.bags.definitions import definition
from visual_servo_epipolar.bags.metadata import distro, PartInfo, SUFFIXES, VERSION

FAULTS = (OSError, sqlite3.Error, WriterError)  # of a disk
PLUGINS = {'mcap': StoragePlugin.MCAP, 'sqlite3': StoragePlugin.SQLITE3}
MODES = {'mcap': CompressionMode.STORAGE, 'sqlite3': CompressionMode.MESSAGE}


@dataclass(frozen=True, slots=True)
class Topic:
    """Topic to record: name, message type, its RIHS01 hash, QoS on offer."""

    name: str
    kind: str  # such as sensor_msgs/msg/Image
    type_hash: str = ''
    qos: tuple[Qos, ...] = ()


class Part:
    """
    Storage file, in a folder of its own until it is whole; for one thread alone.

    In the end it is ``folder/NAME_number.mcap``, or ``.db3``. Every method may raise one of
    FAULTS.
    """

    def __init__(self, folder: Path, number: int, *, storage: str, compression: str) -> None:
        stem = f'{folder.name}_{number}'
        self._path = folder / f'{stem}{SUFFIXES[storage]}'
        self._writer = Writer(folder / stem, version=VERSION, storage_plugin=PLUGINS[storage])
        if compression != 'none':
            self._writer.set_compression(MODES[storage], CompressionFormat.ZSTD)
        try:
            self._writer.open()
        except FAULTS:
            shutil.rmtree(folder / stem, ignore_errors=True)
            raise
        self._connections: dict[str, Connection] = {}
        self._file = _FILES[storage](self._writer.storage)
        self._flushed_info = self._info()
        self._flushed, self._pending = 0, 0  # bytes
        self.start_ns: int | None = None  # stamp of the first message

    @property
    def size(self) -> int:
        """Bytes on the disk, and in memory on their way there."""
        return self._flushed + self._pending

    def add(self, topic: Topic) -> None:
        """Add a topic; raises InputError if its definition is not known."""
        text, digest = definition(topic.kind, topic.type_hash)
        self._connections[topic.name] = self._writer.add_connection(
            topic.name, topic.kind, msgdef=text, rihs01=digest, offered_qos_profiles=topic.qos
        )

    def write(self, topic: str, stamp_ns: int, data: bytes) -> None:
        """Write a serialized message of a topic that was added."""
        self._writer.write(self._connections[topic], stamp_ns, data)
        self._pending += len(data)
        if self.start_ns is None:
            self.start_ns = stamp_ns
        if self._file.has_closed_chunk():
            self.flush()

    def flush(self) -> None:
        """Hand what is in memory to the kernel: it survives the end of this process."""
        self._file.flush()
        self._flushed_info = self._info()
        self._flushed, self._pending = self._file.path.stat().st_size, 0

    def close(self) -> PartInfo:
        """Complete the file, and move it into the folder of the bag."""
        self.flush()
        close_writer(self._writer)
        return self._move_into_place(self._info())

    def abandon(self) -> PartInfo:
        """End the file after a fault, with all that was flushed."""
        self._file.truncate_tail()
        return self._move_into_place(self._flushed_info)

    def _info(self) -> PartInfo:
        writer = self._writer
        return PartInfo(
            self._path.name,
            tuple(writer.connections),
            dict(writer.counts),
            writer.min_timestamp,
            writer.max_timestamp,
        )

    def _move_into_place(self, info: PartInfo) -> PartInfo:
        self._file.path.replace(self._path)
        shutil.rmtree(self._file.path.parent)  # with metadata of this file alone
        return info


def close_writer(writer: Writer) -> None:
    """Complete a file of rosbags, which says that a distribution "rosbags" has recorded it."""
    storage: Any = writer.storage
    complete = storage.close

    def close(version: int, metadata: str) -> None:
        complete(version, metadata.replace('ros_distro: rosbags', f'ros_distro: {distro()}'))

    storage.close = close
    writer.close()


class _Mcap:
    """File of chunks; valid to its last whole chunk, if an end is put behind it."""

    def __init__(self, storage: Any) -> None:
        self._storage, self.path = storage, Path(storage.path)
        storage.bio.flush()
        self._chunks, self._whole = 0, int(storage.bio.tell())

    def has_closed_chunk(self) -> bool:
        """Return whether rosbags has closed a chunk by itself."""
        return len(self._storage.chunks) != self._chunks

    def flush(self) -> None:
        storage = self._storage
        if storage.chunk.msgs:
            storage.close_chunk()
        storage.bio.flush()
        self._chunks, self._whole = len(storage.chunks), int(storage.bio.tell())

    def truncate_tail(self) -> None:
        """Drop an incomplete chunk; an end without an index takes 50 bytes, and can be read."""
        with suppress(OSError, ValueError), open(os.devnull, 'wb') as nowhere:
            # The buffer cannot be emptied: let what is in it go nowhere.
            os.dup2(nowhere.fileno(), self._storage.bio.fileno())
            self._storage.bio.close()
        end = RecordBuilder()
        DataEnd(data_section_crc=0).write(end)
        Footer(summary_start=0, summary_offset_start=0, summary_crc=0).write(end)
        with self.path.open('r+b') as file:
            file.truncate(self._whole)
            file.seek(self._whole)
            file.write(bytes(end.end()) + MCAP0_MAGIC)


class _Sqlite:
    """Database in one table; valid to its last commit."""

    def __init__(self, storage: Any) -> None:
        self._storage, self.path = storage, Path(storage.path)

    def has_closed_chunk(self) -> bool:
        return False

    def flush(self) -> None:
        self._storage.conn.commit()

    def truncate_tail(self) -> None:
        with suppress(sqlite3.Error):
            self._storage.conn.rollback()
        self._storage.conn.close()
        # To be read, it rolls back what is open; rosbags reads databases with no eye to journals.
        with closing(sqlite3.connect(self.path)) as connection:
            connection.execute('SELECT COUNT(*) FROM sqlite_master').fetchone()


_FILES: dict[str, type[_Mcap] | type[_Sqlite]] = {'mcap': _Mcap, 'sqlite3': _Sqlite}
