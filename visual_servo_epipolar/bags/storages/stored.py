"""Stored topics and messages: what every storage file has, as it describes it."""

from collections.abc import Collection, Iterator, Sequence
from dataclasses import dataclass
from types import TracebackType
from typing import Protocol

CDR, ROS1 = 'cdr', 'ros1'  # the encodings of messages of ROS
StoredMessage = tuple[int, int, bytes]  # id of the topic, time of recording [ns], bytes


@dataclass(frozen=True, slots=True)
class StoredTopic:
    """
    Topic as a storage file describes it.

    QoS is YAML; what the file does not say is empty.
    """

    id: int
    topic: str
    kind: str
    definition: str = ''
    schema: str = ''  # language of the definition: ros2msg, ros2idl, ros1msg, jsonschema, ...
    encoding: str = CDR  # of its messages: cdr, ros1, json, protobuf, ...
    qos: str = ''
    type_hash: str = ''
    count: int = 0


class StorageFile(Protocol):
    """Storage file that is open; start and end [ns] are 0 where it has no messages."""

    topics: Sequence[StoredTopic]
    start_ns: int
    end_ns: int

    def __enter__(self) -> 'StorageFile': ...

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None: ...

    def messages(self, ids: Collection[int]) -> Iterator[StoredMessage]:
        """Yield the messages of some topics in the order of time."""
        ...
