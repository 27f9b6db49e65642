"""Recorder: serialized messages into a rosbag2 folder of mcap files, on a thread of its own."""

from collections import Counter, deque
from collections.abc import Mapping
from contextlib import suppress
from dataclasses import dataclass, field, replace
from pathlib import Path
import shutil
import threading
import time

from mcap.data_stream import RecordBuilder
from mcap.records import DataEnd, Footer
from mcap.writer import CompressionType, MCAP0_MAGIC, Writer
import yaml

from visual_servo_epipolar.bags import metadata
from visual_servo_epipolar.bags.definitions import definition
from visual_servo_epipolar.bags.metadata import PartInfo, Topic
from visual_servo_epipolar.bags.recording.settings import RecordSettings
from visual_servo_epipolar.core.errors import InputError, VisualServoError
from visual_servo_epipolar.core.stamps import seconds_between

MB = 1e6
CHUNK_SIZE = 1 << 18  # bytes: an image makes a chunk of its own
COMPRESSIONS = {'none': CompressionType.NONE, 'zstd': CompressionType.ZSTD}


class DiskFullError(VisualServoError):
    """So little space remains that the bag must be completed while that is possible."""


class BagWriter:
    """
    Writer of messages into a new ``folder``, in the order they come in; for one thread alone.

    Raises InputError if that cannot be made; later, OSError or DiskFullError: ``rescue`` then.
    """

    def __init__(self, folder: Path, settings: RecordSettings) -> None:
        self._folder, self._settings = folder, settings
        self._topics: dict[str, Topic] = {}
        self.completed: list[PartInfo] = []
        try:
            folder.mkdir(parents=True)
        except FileExistsError:
            raise InputError(f'{folder} exists already; name another bag') from None
        except OSError as error:
            raise InputError(f'{folder}: bag cannot be written: {error.strerror}') from None
        try:
            self._check_disk()
            self._part: _Part | None = self._begin()
        except (OSError, DiskFullError):
            shutil.rmtree(folder, ignore_errors=True)
            raise

    def add(self, topic: Topic) -> None:
        """Add a topic to this file and to those that follow; its definition must be known."""
        _, digest = definition(topic.kind, topic.type_hash)
        self._topics[topic.name] = replace(topic, type_hash=digest)
        self._open_part().add(self._topics[topic.name])

    def write(self, topic: str, stamp_ns: int, data: bytes) -> None:
        """Write a serialized message of an added topic; a new file begins where it is due."""
        part = self._open_part()
        if self._is_due(part, stamp_ns):
            self._complete(part)
            part = self._open_part()
        part.write(topic, stamp_ns, data)

    def flush(self) -> None:
        """Let what was written survive a kill -9."""
        self._open_part().flush()
        self._check_disk()

    def close(self) -> None:
        """Complete the bag."""
        self._complete(self._open_part())
        self._describe()

    def rescue(self, error: Exception) -> bool:
        """End the bag after ``error`` with all that was flushed; return whether it is whole."""
        part = self._part
        try:
            if part is not None:
                self.completed.append(_ended(part, error))
            self._describe()
        except OSError:
            return False
        return True

    def _begin(self) -> '_Part':
        path = self._folder / f'{self._folder.name}_{len(self.completed)}.mcap'
        part = _Part(path, COMPRESSIONS[self._settings.compression])
        for topic in self._topics.values():
            part.add(topic)
        return part

    def _open_part(self) -> '_Part':
        if self._part is None:
            self._part = self._begin()
        return self._part

    def _complete(self, part: '_Part') -> None:
        self.completed.append(part.close())
        self._part = None

    def _is_due(self, part: '_Part', stamp_ns: int) -> bool:
        settings = self._settings
        if part.first_ns is None:
            return False
        full = 0.0 < settings.split_size * MB <= part.size
        age_s = seconds_between(part.first_ns, stamp_ns)
        return full or 0.0 < settings.split_duration <= age_s

    def _check_disk(self) -> None:
        free, least = shutil.disk_usage(self._folder).free, self._settings.min_free
        if free < least * MB:
            raise DiskFullError(
                f'{free / MB:.0f} MB are free where {self._folder} is, {least:g} MB must stay '
                'free; make space, or lower min_free'
            )

    def _describe(self) -> None:
        metadata.write(self._folder, metadata.described(self.completed))


class _Part:
    """File of mcap that is being written; every method may raise OSError."""

    def __init__(self, path: Path, compression: CompressionType) -> None:
        self._path = path
        self._file = path.open('xb')
        self._writer = Writer(self._file, chunk_size=CHUNK_SIZE, compression=compression)
        self._writer.start('ros2')
        self._schemas: dict[str, int] = {}
        self._channels: dict[str, int] = {}
        self._topics: list[Topic] = []
        self._counts: Counter[str] = Counter()
        self._start_ns, self._end_ns = 2**63, 0
        self.first_ns: int | None = None  # stamp of the first message
        self._pending = 0  # bytes
        self.flush()

    @property
    def info(self) -> PartInfo:
        """What was written so far, flushed or not."""
        topics, counts = tuple(self._topics), dict(self._counts)
        return PartInfo(self._path.name, topics, counts, self._start_ns, self._end_ns)

    @property
    def size(self) -> int:
        """Bytes on the disk, and in memory on their way there."""
        return self._whole + self._pending

    def add(self, topic: Topic) -> None:
        """Add a topic."""
        if topic.kind not in self._schemas:
            text, _ = definition(topic.kind, topic.type_hash)
            self._schemas[topic.kind] = self._writer.register_schema(
                topic.kind, 'ros2msg', text.encode()
            )
        profiles = yaml.safe_dump([dict(item) for item in topic.qos], sort_keys=False)
        about = {'offered_qos_profiles': profiles, 'topic_type_hash': topic.type_hash}
        self._channels[topic.name] = self._writer.register_channel(
            topic.name, topic.encoding, self._schemas[topic.kind], about
        )
        self._topics.append(topic)

    def write(self, topic: str, stamp_ns: int, data: bytes) -> None:
        """Write a serialized message of a topic that was added."""
        self._writer.add_message(self._channels[topic], stamp_ns, data, stamp_ns)
        if self.first_ns is None:
            self.first_ns = stamp_ns
        self._counts[topic] += 1
        self._start_ns, self._end_ns = min(self._start_ns, stamp_ns), max(self._end_ns, stamp_ns)
        self._pending += len(data)
        if self._pending >= CHUNK_SIZE:
            self.flush()

    def flush(self) -> None:
        """Hand what is in memory to the kernel: it survives the end of this process."""
        self._writer.flush()
        self._flushed, self._whole, self._pending = self.info, self._file.tell(), 0

    def close(self) -> PartInfo:
        """Complete the file."""
        self.flush()
        text = yaml.safe_dump(metadata.described([self.info]), sort_keys=False)
        self._writer.add_metadata('rosbag2', {'serialized_metadata': text})
        self._writer.finish()
        self._file.close()
        return self.info

    def abandon(self) -> PartInfo:
        """End the file after a fault, with all that was flushed, but no index."""
        with suppress(OSError, ValueError):
            self._file.close()  # what it holds in memory goes nowhere
        end = RecordBuilder()
        DataEnd(data_section_crc=0).write(end)
        Footer(summary_start=0, summary_offset_start=0, summary_crc=0).write(end)
        with self._path.open('r+b') as file:
            file.truncate(self._whole)
            file.seek(self._whole)
            file.write(bytes(end.end()) + MCAP0_MAGIC)
        return self._flushed


def _ended(part: _Part, error: Exception) -> PartInfo:
    """End a file after ``error``; raises OSError if that cannot be done."""
    if isinstance(error, DiskFullError):
        with suppress(OSError):
            return part.close()  # there is space for this
    return part.abandon()


PAUSE_S = 0.05  # that messages may wait for others to be written with them
BATCH_BYTES = 1 << 20  # that do not wait for others

Item = tuple[Topic, int, bytes | None]  # without bytes: add the topic


@dataclass(frozen=True, slots=True)
class RecordingStatus:
    """Status of a recording; counts are of messages, by topic."""

    written: Mapping[str, int] = field(default_factory=dict)
    dropped: Mapping[str, int] = field(default_factory=dict)  # the disk was too slow, or full
    waiting_bytes: int = 0
    files: int = 1
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
        self._waiting_bytes, self._files = 0, 1
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
                self._files,
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
            self._files = 1 + len(writer.completed)
            self._written[topic.name] += 1
            self._waiting_bytes -= len(data)
            self._changed.notify_all()

    def _fail(self, error: Exception, writer: BagWriter | None) -> None:
        """End the bag, and count the messages that are not in it."""
        whole = writer is not None and writer.rescue(error)
        state = 'is whole' if whole else 'must be repaired once there is space'
        with self._changed:
            self._error = str(error)
            if writer is not None:
                self._error = f'recording ended: {reason(error)}; {self.folder} so far {state}'
                self._written = sum((Counter(it.counts) for it in writer.completed), Counter())
            self._dropped.update(self._taken - self._written)
            self._open, self._waiting_bytes = False, 0
            self._queue.clear()
            self._changed.notify_all()


def reason(error: Exception) -> str:
    """Return the message of an error in one line, without numbers of the system."""
    message = getattr(error, 'strerror', None) or str(error) or type(error).__name__
    return ' '.join(message.split())
