"""Stored topics: what every storage file has, which can be read, and why others are not."""

from collections.abc import Callable, Collection, Iterator, Sequence
from contextlib import AbstractContextManager
from dataclasses import dataclass
from functools import cache

from rosbags.typesys import get_typestore, Stores
from rosbags.typesys.store import Typestore

CDR, ROS1 = 'cdr', 'ros1'  # the encodings of messages of ROS
StoredMessage = tuple[int, int, bytes]  # id of the topic, time of recording [ns], bytes
MESSAGE_LANGUAGES = ('ros1msg', 'ros2msg')
IDL_LANGUAGES = ('ros2idl', 'omgidl')
MOST_NAMED = 4  # topics that a note names


@dataclass(frozen=True, slots=True)
class StoredTopic:
    """Topic as a storage file describes it; QoS is YAML, and what it does not say is empty."""

    id: int
    topic: str
    kind: str
    definition: str = ''
    schema: str = ''  # language of the definition: ros2msg, ros2idl, ros1msg, jsonschema, ...
    encoding: str = CDR  # of its messages: cdr, ros1, json, protobuf, ...
    qos: str = ''
    type_hash: str = ''
    count: int = 0


@dataclass(frozen=True, slots=True)
class StorageFile(AbstractContextManager['StorageFile']):
    """
    Storage file that is open; start and end [ns] are 0 where it has no messages.

    ``messages`` yields those of the topics of some ids, in the order of time.
    """

    topics: Sequence[StoredTopic]
    start_ns: int
    end_ns: int
    messages: Callable[[Collection[int]], Iterator[StoredMessage]]
    close: Callable[[], object] = lambda: None

    def __exit__(self, *_: object) -> None:
        self.close()


def kind_of(item: StoredTopic) -> str:
    """Return the type of a topic as package/msg/Name, which ROS 1 has as package/Name."""
    package, slash, name = item.kind.partition('/')
    return f'{package}/msg/{name}' if slash and '/' not in name else item.kind


@cache
def types_of(encoding: str) -> Typestore:
    """Return the types of ROS; those read here have not changed since dashing."""
    return get_typestore(Stores.ROS1_NOETIC if encoding == ROS1 else Stores.ROS2_JAZZY)


def refusal(item: StoredTopic) -> str:
    """Return why the messages of a topic are not read; empty if they are."""
    if item.encoding not in (CDR, ROS1):
        return f'their messages are {item.encoding or "of no known encoding"}, not of ROS'
    defined = item.schema in (*MESSAGE_LANGUAGES, *IDL_LANGUAGES) and item.definition
    if not defined and kind_of(item) not in types_of(item.encoding).fielddefs:
        return 'the definition of their type was not found when recording'
    return ''


def left_out(stored: Collection[StoredTopic]) -> list[str]:
    """Return a note for each reason why topics are left out, which names them."""
    reasons: dict[str, dict[str, None]] = {}
    for item in stored:
        if refusal(item):
            name = f'{item.topic} ({item.kind})' if item.kind else item.topic
            reasons.setdefault(refusal(item), {})[name] = None
    return [
        f'left out, for {reason}: {", ".join(list(names)[:MOST_NAMED])}'
        + (f' and {len(names) - MOST_NAMED} more' if len(names) > MOST_NAMED else '')
        for reason, names in reasons.items()
    ]
