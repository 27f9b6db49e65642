"""Recorder: serialized messages into a rosbag2 folder of mcap, on a thread of its own."""

from collections import Counter, deque
from collections.abc import Mapping
from contextlib import suppress
from dataclasses import dataclass, field, replace
import os
from pathlib import Path
import shutil
import threading
import time
from typing import Any

from mcap.data_stream import RecordBuilder
from mcap.records import DataEnd, Footer
from mcap.writer import CompressionType, MCAP0_MAGIC, Writer
import yaml

from visual_servo_epipolar.bags.definitions import definition, METADATA
from visual_servo_epipolar.bags.recording.settings import RecordSettings
from visual_servo_epipolar.core.errors import InputError, VisualServoError
from visual_servo_epipolar.files import whole

MB = 1e6
VERSION, DISTRO = 9, 'jazzy'  # of rosbag2, and of ROS where none is sourced
CHUNK_SIZE = 1 << 18  # bytes: an image makes a chunk of its own
COMPRESSIONS = {'none': CompressionType.NONE, 'zstd': CompressionType.ZSTD}


class DiskFullError(VisualServoError):
    """So little space remains that the bag must be completed while that is possible."""


@dataclass(frozen=True, slots=True)
class Topic:
    """Topic of a bag: name, message type, its RIHS01 hash, QoS as in metadata.yaml."""

    name: str
    kind: str  # such as sensor_msgs/msg/Image
    type_hash: str = ''
    qos: tuple[Mapping[str, Any], ...] = ()
    encoding: str = 'cdr'


class BagWriter:
    """
    Writer of messages into a new ``folder``, in the order they come in; for one thread alone.

    Raises InputError if that cannot be made; later, OSError or DiskFullError: ``rescue`` then.
    """

    def __init__(self, folder: Path, settings: RecordSettings) -> None:
        self._folder, self._min_free = folder, settings.min_free
        self._path = folder / f'{folder.name}_0.mcap'
        self._schemas: dict[str, int] = {}
        self._channels: dict[str, int] = {}
        self._topics: dict[str, Topic] = {}
        self._counts: Counter[str] = Counter()
        self._start_ns, self._end_ns, self._pending = 2**63, 0, 0  # bytes in memory
        try:
            folder.mkdir(parents=True)
        except FileExistsError:
            raise InputError(f'{folder} exists already; name another bag') from None
        except OSError as error:
            raise InputError(f'{folder}: bag cannot be written: {error.strerror}') from None
        try:
            self._check_disk()
            self._file = self._path.open('xb')
            compression = COMPRESSIONS[settings.compression]
            self._writer = Writer(self._file, chunk_size=CHUNK_SIZE, compression=compression)
            self._writer.start('ros2')
            self.flush()
        except (OSError, DiskFullError):
            shutil.rmtree(folder, ignore_errors=True)
            raise

    def add(self, topic: Topic) -> None:
        """Add a topic; its definition must be known."""
        text, digest = definition(topic.kind, topic.type_hash)
        if topic.kind not in self._schemas:
            self._schemas[topic.kind] = self._writer.register_schema(
                topic.kind, 'ros2msg', text.encode()
            )
        profiles = yaml.safe_dump([dict(item) for item in topic.qos], sort_keys=False)
        about = {'offered_qos_profiles': profiles, 'topic_type_hash': digest}
        self._channels[topic.name] = self._writer.register_channel(
            topic.name, topic.encoding, self._schemas[topic.kind], about
        )
        self._topics[topic.name] = replace(topic, type_hash=digest)

    def write(self, topic: str, stamp_ns: int, data: bytes) -> None:
        """Write a serialized message of an added topic."""
        self._writer.add_message(self._channels[topic], stamp_ns, data, stamp_ns)
        self._counts[topic] += 1
        self._start_ns, self._end_ns = min(self._start_ns, stamp_ns), max(self._end_ns, stamp_ns)
        self._pending += len(data)
        if self._pending >= CHUNK_SIZE:
            self._hand_over()

    def flush(self) -> None:
        """Let what was written survive a kill -9."""
        self._hand_over()
        self._check_disk()

    def close(self) -> None:
        """Complete the bag."""
        self._hand_over()
        text = yaml.safe_dump(self._description(), sort_keys=False)
        self._writer.add_metadata('rosbag2', {'serialized_metadata': text})
        self._writer.finish()
        self._file.close()
        self._describe()

    def rescue(self, error: Exception) -> Mapping[str, int] | None:
        """End the bag after ``error``; return how much is in it, None where it is not whole."""
        try:
            if isinstance(error, DiskFullError):
                with suppress(OSError):  # there is space for this
                    self.close()
                    return self._counts
            self._abandon()
        except OSError:
            return None
        return self._counts

    def _abandon(self) -> None:
        """End the file with all that was flushed, but no index."""
        with suppress(OSError, ValueError):
            self._file.close()  # what it holds in memory goes nowhere
        end = RecordBuilder()
        DataEnd(data_section_crc=0).write(end)
        Footer(summary_start=0, summary_offset_start=0, summary_crc=0).write(end)
        with self._path.open('r+b') as file:
            file.truncate(self._whole)
            file.seek(self._whole)
            file.write(bytes(end.end()) + MCAP0_MAGIC)
        self._counts, self._start_ns, self._end_ns = self._flushed
        self._describe()

    def _hand_over(self) -> None:
        """Hand what is in memory to the kernel: it survives the end of this process."""
        self._writer.flush()
        self._flushed = self._counts.copy(), self._start_ns, self._end_ns
        self._whole, self._pending = self._file.tell(), 0

    def _check_disk(self) -> None:
        free = shutil.disk_usage(self._folder).free
        if free < self._min_free * MB:
            raise DiskFullError(
                f'{free / MB:.0f} MB are free where {self._folder} is, {self._min_free:g} MB must '
                'stay free; make space, or lower min_free'
            )

    def _describe(self) -> None:
        with whole(self._folder / METADATA) as partial:
            document = {'rosbag2_bagfile_information': self._description()}
            text = yaml.safe_dump(document, sort_keys=False)
            partial.write_text(text, encoding='utf-8')

    def _description(self) -> dict[str, Any]:
        """Return what metadata.yaml says."""
        start_ns, count = min(self._start_ns, self._end_ns), self._counts.total()
        extent = {
            'duration': {'nanoseconds': self._end_ns - start_ns},
            'starting_time': {'nanoseconds_since_epoch': start_ns},
            'message_count': count,
        }
        return {
            'version': VERSION,
            'storage_identifier': 'mcap',
            'relative_file_paths': [self._path.name],
            **extent,
            'topics_with_message_count': [
                {
                    'topic_metadata': {
                        'name': topic.name,
                        'type': topic.kind,
                        'serialization_format': topic.encoding,
                        'offered_qos_profiles': [dict(item) for item in topic.qos],
                        'type_description_hash': topic.type_hash,
                    },
                    'message_count': self._counts[topic.name],
                }
                for topic in self._topics.values()
            ],
            'compression_format': '',
            'compression_mode': '',
            'files': [{'path': self._path.name, **extent}],
            'custom_data': None,
            'ros_distro': os.environ.get('ROS_DISTRO') or DISTRO,
        }


PAUSE_S = 0.05  # that messages may wait for others to be written with them
BATCH_BYTES = 1 << 20  # that do not wait for others

Item = tuple[Topic, int, bytes | None]  # without bytes: add the topic


@dataclass(frozen=True, slots=True)
class RecordingStatus:
    """Status of a recording; counts are of messages, by topic."""

    written: Mapping[str, int] = field(default_factory=dict)
    dropped: Mapping[str, int] = field(default_factory=dict)  # the disk was too slow, or full
    waiting_bytes: int = 0
    error: str = ''


class Recorder:
    """
    Recorder of a bag in a new ``folder``: ``put`` does not wait for the disk, a thread writes.

    What came in more than ``flush_period`` ago survives a kill -9, as long as the disk keeps up.
    The thread writes what came in since it last looked, some twenty times a second: woken for each
    message it would keep its own process from going on. When it fails, or is nearly full, the bag
    is ended as it is and ``status().error`` says why. Raises InputError if the bag cannot be
    begun.
    """

    def __init__(self, folder: Path, settings: RecordSettings | None = None) -> None:
        self.folder, self._settings = folder, settings or RecordSettings()
        self._queue = deque[Item]()
        self._waiting_bytes = 0
        self._taken: Counter[str] = Counter()
        self._written: Counter[str] = Counter()
        self._dropped: Counter[str] = Counter()
        self._error, self._closing, self._open, self._is_urgent = '', False, False, False
        self._changed = threading.Condition()
        self._thread = threading.Thread(target=self._run, name='recorder', daemon=True)
        self._thread.start()
        with self._changed:
            self._changed.wait_for(lambda: self._open or self._error)
        if not self._open:
            self._thread.join()
            raise InputError(self._error)

    def add(self, topic: Topic) -> None:
        """Add a topic; raises InputError if no definition of its messages is known."""
        definition(topic.kind, topic.type_hash)
        with self._changed:
            self._queue.append((topic, 0, None))

    def put(self, topic: Topic, stamp_ns: int, data: bytes) -> bool:
        """Queue a serialized message of an added topic; return False if it had to be dropped."""
        limit = self._settings.queue_size * MB
        with self._changed:

            def fits() -> bool:  # the first does, however large
                return self._waiting_bytes == 0 or self._waiting_bytes + len(data) <= limit

            if self._settings.when_full == 'wait' and not fits():
                self._hurry()
                self._changed.wait_for(lambda: fits() or not self._open)
            if self._closing or not (self._open and fits()):
                self._dropped[topic.name] += 1
                return False
            self._queue.append((topic, stamp_ns, data))
            self._taken[topic.name] += 1
            self._waiting_bytes += len(data)
            if self._waiting_bytes >= min(BATCH_BYTES, 0.5 * limit):
                self._hurry()
        return True

    def status(self) -> RecordingStatus:
        """Return the status of the recording."""
        with self._changed:
            return RecordingStatus(
                dict(self._written),
                dict(self._dropped),
                self._waiting_bytes,
                self._error,
            )

    def close(self) -> RecordingStatus:
        """Write what waits, complete the bag, and return its status."""
        with self._changed:
            self._closing = True
            self._hurry()
        self._thread.join()
        return self.status()

    def _hurry(self) -> None:
        """Let the thread write at once, and not wait for more."""
        self._is_urgent = True
        self._changed.notify_all()

    def _run(self) -> None:
        """Run the thread: write until closed, or until the disk fails."""
        writer: BagWriter | None = None
        error: Exception | None = RuntimeError('a mistake in the recorder, see above')
        try:
            writer = BagWriter(self.folder, self._settings)
            with self._changed:
                self._open = True
                self._changed.notify_all()
            self._write_all(writer)
            writer.close()
            error = None
        except (OSError, InputError, DiskFullError) as trouble:
            error = trouble
        finally:  # a mistake is raised, but not in silence
            if error is not None:
                self._fail(error, writer)

    def _write_all(self, writer: BagWriter) -> None:
        """Write messages as they come, and flush in time, until closed."""
        period = self._settings.flush_period
        due = time.monotonic() + period
        items = deque[Item]()
        while self._open:
            if not items:
                pause = max(min(PAUSE_S, due - time.monotonic()), 0.0)
                with self._changed:
                    self._changed.wait_for(lambda: self._is_urgent, pause)
                    items, self._queue, self._is_urgent = self._queue, deque(), self._closing
                    self._open = bool(items) or not self._closing
            if items:
                self._write(writer, *items.popleft())
            if time.monotonic() >= due:
                writer.flush()
                due = time.monotonic() + period

    def _write(self, writer: BagWriter, topic: Topic, stamp_ns: int, data: bytes | None) -> None:
        if data is None:
            writer.add(topic)
            return
        writer.write(topic.name, stamp_ns, data)
        with self._changed:
            self._written[topic.name] += 1
            self._waiting_bytes -= len(data)
            self._changed.notify_all()

    def _fail(self, error: Exception, writer: BagWriter | None) -> None:
        """End the bag, and count the messages that are not in it."""
        kept = None if writer is None else writer.rescue(error)
        state = 'must be repaired once there is space' if kept is None else 'is whole'
        with self._changed:
            self._error = str(error)
            if writer is not None:
                self._error = f'recording ended: {reason(error)}; {self.folder} so far {state}'
                self._written = Counter(kept or {})
            self._dropped.update(self._taken - self._written)
            self._open, self._waiting_bytes = False, 0
            self._queue.clear()
            self._changed.notify_all()


def reason(error: Exception) -> str:
    """Return the message of an error in one line, without numbers of the system."""
    message = getattr(error, 'strerror', None) or str(error) or type(error).__name__
    return ' '.join(message.split())
