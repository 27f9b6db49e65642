"""Metadata of a rosbag2 folder, metadata.yaml: what is in which storage file."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
import os
from pathlib import Path
from typing import Any, Final

from rosbags.interfaces import Connection, ConnectionExtRosbag2
from rosbags.rosbag2.metadata import dump_qos_v9
import yaml

from visual_servo_epipolar.files import whole

VERSION: Final = 9  # of rosbag2, that of Jazzy
FILE = 'metadata.yaml'
DISTRO: Final = 'jazzy'  # where none is sourced: its messages are those that bags hold
SUFFIXES = {'mcap': '.mcap', 'sqlite3': '.db3'}


@dataclass(frozen=True, slots=True)
class PartInfo:
    """Content of a storage file: its topics, how many messages of each, from when to when."""

    file: str
    connections: tuple[Connection, ...]
    counts: Mapping[int, int]  # of messages, by id of the connection
    start_ns: int
    end_ns: int

    @property
    def count(self) -> int:
        """Number of messages."""
        return sum(self.counts.values())


def distro() -> str:
    """Return the name of the ROS distribution that records."""
    return os.environ.get('ROS_DISTRO') or DISTRO


def document(parts: Sequence[PartInfo], storage: str, compression_mode: str) -> dict[str, Any]:
    """
    Return what metadata.yaml says of a bag of ``parts``.

    ``compression_mode`` is '' or 'message'; what a storage compresses by itself is not said.
    """
    filled = [part for part in parts if part.count]
    start_ns = min((part.start_ns for part in filled), default=0)
    end_ns = max((part.end_ns for part in filled), default=0)
    return {
        'rosbag2_bagfile_information': {
            'version': VERSION,
            'storage_identifier': storage,
            'relative_file_paths': [part.file for part in parts],
            'duration': {'nanoseconds': end_ns - start_ns},
            'starting_time': {'nanoseconds_since_epoch': start_ns},
            'message_count': sum(part.count for part in parts),
            'topics_with_message_count': _topics(parts),
            'compression_format': 'zstd' if compression_mode else '',
            'compression_mode': compression_mode,
            'files': [_file(part) for part in parts],
            'custom_data': None,
            'ros_distro': distro(),
        }
    }


def write(folder: Path, content: Mapping[str, Any]) -> None:
    """Write metadata.yaml into ``folder``, by rename."""
    with whole(folder / FILE) as partial:
        partial.write_text(yaml.safe_dump(dict(content), sort_keys=False), encoding='utf-8')


def listed_files(folder: Path) -> list[str] | None:
    """Return the names of the storage files that metadata.yaml lists, None if it is broken."""
    try:
        content = yaml.safe_load((folder / FILE).read_text(encoding='utf-8'))
        paths = content['rosbag2_bagfile_information']['relative_file_paths']
        # Early versions put the folder of the bag in front.
        return [Path(item).name for item in paths]
    except (OSError, ValueError, LookupError, TypeError, RecursionError, yaml.YAMLError):
        return None


def _file(part: PartInfo) -> dict[str, Any]:
    start_ns, end_ns = (part.start_ns, part.end_ns) if part.count else (0, 0)
    return {
        'path': part.file,
        'starting_time': {'nanoseconds_since_epoch': start_ns},
        'duration': {'nanoseconds': end_ns - start_ns},
        'message_count': part.count,
    }


def _topics(parts: Sequence[PartInfo]) -> list[dict[str, Any]]:
    """Return each topic once, with its messages in all parts."""
    topics: dict[str, dict[str, Any]] = {}
    for part in parts:
        for connection in part.connections:
            entry = topics.setdefault(
                connection.topic, {'topic_metadata': _topic(connection), 'message_count': 0}
            )
            entry['message_count'] += part.counts.get(connection.id, 0)
    return list(topics.values())


def _topic(connection: Connection) -> dict[str, Any]:
    extra = connection.ext
    if not isinstance(extra, ConnectionExtRosbag2):
        raise TypeError(f'a connection of rosbag2 is needed, got one of {type(extra).__name__}')
    return {
        'name': connection.topic,
        'type': connection.msgtype,
        'serialization_format': extra.serialization_format,
        'offered_qos_profiles': [dict(item) for item in dump_qos_v9(extra.offered_qos_profiles)],
        'type_description_hash': connection.digest,
    }
