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
        self._queue: deque[Item] = deque()
        self._waiting_bytes, self._files = 0, 1
        self._written: Counter[str] = Counter()
        self._dropped: Counter[str] = Counter()
        self._error, self._closing, self._open, self._held_up = '', False, False, False
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
            self._changed.notify_all()

    def put(self, topic: Topic, stamp_ns: int, data: bytes) -> bool:
        """Queue a serialized message of an added topic; return False if it had to be dropped."""
        with self._changed:
            if self._settings.when_full == 'wait' and not self._fits_queue(len(data)):
                self._held_up = True
                self._changed.notify_all()
                self._changed.wait_for(lambda: self._fits_queue(len(data)) or not self._open)
                self._held_up = False
            if not (self._open and self._fits_queue(len(data))):
                self._dropped[topic.name] += 1
                return False
            self._queue.append((topic, stamp_ns, data))
            self._waiting_bytes += len(data)
            if self._is_urgent():
                self._changed.notify_all()
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
            self._changed.notify_all()
        self._thread.join()
        return self.status()

    def _fits_queue(self, size: int) -> bool:
        """Return whether a message fits; the first does, however large."""
        limit = self._settings.queue_size * MB
        return self._waiting_bytes == 0 or self._waiting_bytes + size <= limit

    def _is_urgent(self) -> bool:
        """Return whether to write at once, and not wait for more."""
        enough = min(BATCH_BYTES, 0.5 * self._settings.queue_size * MB)
        return self._closing or self._held_up or self._waiting_bytes >= enough

    def _run(self) -> None:
        """Run the thread: write until closed, or until the disk fails."""
        writer: BagWriter | None = None
        whole = False
        try:
            writer = BagWriter(self.folder, self._settings)
            self._set_open(is_open=True)
            self._write_all(writer)
            writer.close()
            whole = True
        except (OSError, InputError, DiskFullError) as error:
            self._fail(error, writer)
        finally:
            if not (whole or self._error):  # not in silence
                self._fail(RuntimeError('a mistake in the recorder, see above'), writer)
            self._set_open(is_open=False)

    def _write_all(self, writer: BagWriter) -> None:
        """Write messages as they come, and flush in time, until closed."""
        period = self._settings.flush_period
        due = time.monotonic() + period
        while True:
            item = self._next(due)
            if item is not None:
                self._write(writer, *item)
            elif self._is_over():
                return
            if time.monotonic() >= due:
                writer.flush()
                due = time.monotonic() + period

    def _next(self, due: float) -> Item | None:
        """Return the next item to write; None where there is none, or a flush is due."""
        with self._changed:
            if not self._queue:
                pause = min(PAUSE_S, due - time.monotonic())
                self._changed.wait_for(self._is_urgent, max(pause, 0.0))
            return self._queue[0] if self._queue else None

    def _is_over(self) -> bool:
        """Return whether all is written that came before the end; what comes now is dropped."""
        with self._changed:  # as one: a message may come since the queue was found empty
            over = self._closing and not self._queue
            self._open = not over
            return over

    def _write(self, writer: BagWriter, topic: Topic, stamp_ns: int, data: bytes | None) -> None:
        if data is None:
            writer.add(topic)
        else:
            writer.write(topic.name, stamp_ns, data)
        with self._changed:
            self._queue.popleft()
            self._files = 1 + len(writer.completed)
            if data is not None:
                self._written[topic.name] += 1
                self._waiting_bytes -= len(data)
            if self._held_up:
                self._changed.notify_all()

    def _set_open(self, *, is_open: bool) -> None:
        with self._changed:
            self._open = is_open
            self._changed.notify_all()

    def _fail(self, error: Exception, writer: BagWriter | None) -> None:
        """End the bag, and count the messages that are not in it."""
        if writer is None:
            self._error = str(error)
            return
        whole = writer.rescue(error)
        stored = Counter[str]()
        for part in writer.completed:
            stored.update(part.counts)
        state = 'is whole' if whole else 'must be repaired once there is space'
        with self._changed:
            lost = self._written - stored
            lost.update(topic.name for topic, _, data in self._queue if data is not None)
            self._dropped.update(lost)
            self._written, self._waiting_bytes = stored, 0
            self._queue.clear()
            self._open = False  # here, or what came in between would be in no count
            self._error = f'recording ended: {reason(error)}; {self.folder} so far {state}'


def reason(error: Exception) -> str:
    """Return the message of an error in one line, without numbers of the system."""
    message = getattr(error, 'strerror', None) or str(error) or type(error).__name__
    return ' '.join(message.split())
