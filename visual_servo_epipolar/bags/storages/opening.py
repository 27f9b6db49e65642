"""Opening a storage file: what it is, its bytes tell."""

from collections.abc import Callable, Collection, Iterator, Mapping, Sequence
from pathlib import Path

from rosbags import rosbag1

from visual_servo_epipolar.bags import containers
from visual_servo_epipolar.bags.storages.mcap_file import McapFile
from visual_servo_epipolar.bags.storages.sqlite_file import SqliteFile
from visual_servo_epipolar.bags.storages.stored import (
    ROS1,
    StorageFile,
    StoredMessage,
    StoredTopic,
)


class Ros1File:
    """Bag of ROS 1."""

    def __init__(self, path: Path) -> None:
        self._reader = rosbag1.Reader(path)
        self._reader.open()
        self.start_ns, self.end_ns = self._reader.start_time, self._reader.end_time
        self.topics: Sequence[StoredTopic] = [
            StoredTopic(
                item.id,
                item.topic,
                item.msgtype,
                item.msgdef.data,
                'ros1msg',
                ROS1,
                count=item.msgcount,
            )
            for item in self._reader.connections
        ]

    def __enter__(self) -> 'Ros1File':
        return self

    def __exit__(self, *_: object) -> None:
        self._reader.close()

    def messages(self, ids: Collection[int]) -> Iterator[StoredMessage]:
        """Yield the messages of some topics in the order of time."""
        chosen = [item for item in self._reader.connections if item.id in ids]
        for connection, stamp_ns, data in self._reader.messages(chosen):
            yield connection.id, stamp_ns, data


FILES: Mapping[str, Callable[[Path], StorageFile]] = {
    'mcap': McapFile,
    'sqlite3': SqliteFile,
    containers.ROS1: Ros1File,
}


def open_storage(path: Path) -> StorageFile:
    """Open a storage file, which must be unpacked; raises InputError if it is none."""
    return FILES[containers.container(path)](path)
