"""Recorder: serialized messages into a rosbag2 folder, on a thread of its own."""

from collections import Counter, deque
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
import threading
import time

from visual_servo_epipolar.bags.definitions import definition
from visual_servo_epipolar.bags.metadata import Topic
from visual_servo_epipolar.bags.recording.settings import RecordSettings
from visual_servo_epipolar.bags.recording.writer import BagWriter, DiskFullError, MB
from visual_servo_epipolar.core.errors import InputError

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
