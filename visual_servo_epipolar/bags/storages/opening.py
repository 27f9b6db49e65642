"""Opening a storage file: what it is, its bytes tell."""

from collections.abc import Callable, Collection, Iterator, Mapping
from pathlib import Path

from rosbags import rosbag1

from visual_servo_epipolar.bags import containers
from visual_servo_epipolar.bags.storages.mcap_file import mcap_file
from visual_servo_epipolar.bags.storages.sqlite_file import sqlite_file
from visual_servo_epipolar.bags.storages.stored import (
    ROS1,
    StorageFile,
    StoredMessage,
    StoredTopic,
)


def ros1_file(path: Path) -> StorageFile:
    """Open a bag of ROS 1."""
    reader = rosbag1.Reader(path)
    reader.open()

    def messages(ids: Collection[int]) -> Iterator[StoredMessage]:
        chosen = [item for item in reader.connections if item.id in ids]
        for connection, stamp_ns, data in reader.messages(chosen):
            yield connection.id, stamp_ns, data

    topics = [
        StoredTopic(
            item.id,
            item.topic,
            item.msgtype,
            item.msgdef.data,
            'ros1msg',
            ROS1,
            count=item.msgcount,
        )
        for item in reader.connections
    ]
    return StorageFile(topics, reader.start_time, reader.end_time, messages, reader.close)


FILES: Mapping[str, Callable[[Path], StorageFile]] = {
    'mcap': mcap_file,
    'sqlite3': sqlite_file,
    containers.ROS1: ros1_file,
}


def open_storage(path: Path) -> StorageFile:
    """Open a storage file, which must be unpacked; raises InputError if it is none."""
    return FILES[containers.container(path)](path)
