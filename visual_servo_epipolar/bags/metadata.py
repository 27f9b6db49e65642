"""Metadata of a rosbag2 folder, metadata.yaml: what is in which storage file."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
import os
from pathlib import Path
from typing import Any

from rosbags.interfaces import QosDurability, QosHistory, QosLiveliness, QosReliability
import yaml

from visual_servo_epipolar.files import whole

VERSION = 9  # of rosbag2, that of Jazzy
FILE, KEY = 'metadata.yaml', 'rosbag2_bagfile_information'
DISTRO = 'jazzy'  # where none is sourced: its messages are those that bags hold
NEEDED = {
    'version',
    'storage_identifier',
    'relative_file_paths',
    'duration',
    'starting_time',
    'message_count',
    'topics_with_message_count',
}
SUFFIXES = {'mcap': '.mcap', 'sqlite3': '.db3'}
POLICIES = {  # of QoS, which earlier distributions write as numbers
    'history': QosHistory,
    'reliability': QosReliability,
    'durability': QosDurability,
    'liveliness': QosLiveliness,
}


@dataclass(frozen=True, slots=True)
class Topic:
    """Topic of a bag: name, message type, its RIHS01 hash, QoS as in metadata.yaml."""

    name: str
    kind: str  # such as sensor_msgs/msg/Image
    type_hash: str = ''
    qos: tuple[Mapping[str, Any], ...] = ()
    encoding: str = 'cdr'


@dataclass(frozen=True, slots=True)
class PartInfo:
    """Content of a storage file: its topics, how many messages of each, from when to when."""

    file: str
    topics: tuple[Topic, ...]
    counts: Mapping[str, int]  # of messages, by topic
    start_ns: int
    end_ns: int

    @property
    def count(self) -> int:
        """Number of messages."""
        return sum(self.counts.values())


def described(
    parts: Sequence[PartInfo], storage: str = 'mcap', compression_mode: str = ''
) -> dict[str, Any]:
    """Return what metadata.yaml says of ``parts``; ``compression_mode``: '', 'message', 'file'."""
    return {
        'version': VERSION,
        'storage_identifier': storage,
        'relative_file_paths': [part.file for part in parts],
        **_extent(parts),
        'topics_with_message_count': _topics(parts),
        'compression_format': 'zstd' if compression_mode else '',
        'compression_mode': compression_mode,
        'files': [{'path': part.file, **_extent([part])} for part in parts],
        'custom_data': None,
        'ros_distro': os.environ.get('ROS_DISTRO') or DISTRO,
    }


def write(folder: Path, content: Mapping[str, Any]) -> None:
    """Write metadata.yaml into ``folder``, by rename."""
    with whole(folder / FILE) as partial:
        text = yaml.safe_dump({KEY: dict(content)}, sort_keys=False)
        partial.write_text(text, encoding='utf-8')


def information(folder: Path) -> Mapping[str, Any] | None:
    """Return what metadata.yaml says, None if it is missing or broken."""
    try:
        found = yaml.safe_load((folder / FILE).read_text(encoding='utf-8'))[KEY]
    except (OSError, ValueError, LookupError, TypeError, RecursionError, yaml.YAMLError):
        return None
    return found if isinstance(found, Mapping) else None


def listed_files(folder: Path) -> list[str] | None:
    """Return the names of the storage files that metadata.yaml lists, None if it is broken."""
    paths = (information(folder) or {}).get('relative_file_paths')
    if not isinstance(paths, list) or not all(isinstance(item, str) and item for item in paths):
        return None
    return [Path(item).name for item in paths]  # early versions put the folder of the bag in front


def qos_profiles(text: str) -> tuple[Mapping[str, Any], ...]:
    """Return QoS as in metadata.yaml, from what a storage file says; none if it is broken."""
    try:
        return tuple(
            {
                key: POLICIES[key](value).name.lower()
                if key in POLICIES and isinstance(value, int)
                else value
                for key, value in profile.items()
            }
            for profile in yaml.safe_load(text) or ()
        )
    except (AttributeError, TypeError, ValueError, yaml.YAMLError):
        return ()


def _extent(parts: Sequence[PartInfo]) -> dict[str, Any]:
    """Return from when to when the messages of ``parts`` are, and how many."""
    filled = [part for part in parts if part.count]
    start_ns = min((part.start_ns for part in filled), default=0)
    end_ns = max((part.end_ns for part in filled), default=0)
    return {
        'duration': {'nanoseconds': end_ns - start_ns},
        'starting_time': {'nanoseconds_since_epoch': start_ns},
        'message_count': sum(part.count for part in parts),
    }


def _topics(parts: Sequence[PartInfo]) -> list[dict[str, Any]]:
    """Return each topic once, with its messages in all parts."""
    topics: dict[str, Topic] = {}
    for part in parts:
        for topic in part.topics:
            topics.setdefault(topic.name, topic)
    return [
        {
            'topic_metadata': {
                'name': topic.name,
                'type': topic.kind,
                'serialization_format': topic.encoding,
                'offered_qos_profiles': [dict(item) for item in topic.qos],
                'type_description_hash': topic.type_hash,
            },
            'message_count': sum(part.counts.get(topic.name, 0) for part in parts),
        }
        for topic in topics.values()
    ]
