"""Writer of a rosbag2 folder: one storage file after the other, one metadata.yaml for all."""

from pathlib import Path
import shutil

from visual_servo_epipolar.bags import metadata
from visual_servo_epipolar.bags.metadata import PartInfo
from visual_servo_epipolar.bags.recording.settings import RecordSettings
from visual_servo_epipolar.bags.storage import FAULTS, Part, Topic
from visual_servo_epipolar.core.errors import InputError, VisualServoError
from visual_servo_epipolar.core.stamps import seconds_between

MB = 1e6


class DiskFullError(VisualServoError):
    """So little space remains that the bag must be completed while that is possible."""


class BagWriter:
    """
    Writer of messages into a new ``folder``, in the order they come in; for one thread alone.

    Raises InputError if that cannot be made; later, one of FAULTS or DiskFullError: ``abandon``
    then.
    """

    def __init__(self, folder: Path, settings: RecordSettings) -> None:
        self._folder, self._settings = folder, settings
        self._topics: dict[str, Topic] = {}
        self.completed: list[PartInfo] = []
        make_folder(folder)
        try:
            self._check_disk()
            self._part: Part | None = self._begin()
        except (*FAULTS, DiskFullError):
            shutil.rmtree(folder, ignore_errors=True)
            raise

    def add(self, topic: Topic) -> None:
        """Add ``topic`` to this file and to those that follow."""
        self._topics[topic.name] = topic
        self._open_part().add(topic)

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
        ends = [] if part is None else [part.abandon]
        if part is not None and isinstance(error, DiskFullError):
            ends.insert(0, part.close)  # there is space for this
        for end in ends:
            try:
                self.completed.append(end())
                break
            except FAULTS:
                continue
        else:
            if ends:
                return False
        try:
            self._describe()
        except FAULTS:
            return False
        return True

    def _begin(self) -> Part:
        part = Part(
            self._folder,
            len(self.completed),
            storage=self._settings.storage,
            compression=self._settings.compression,
        )
        for topic in self._topics.values():
            part.add(topic)
        return part

    def _open_part(self) -> Part:
        if self._part is None:
            self._part = self._begin()
        return self._part

    def _complete(self, part: Part) -> None:
        self.completed.append(part.close())
        self._part = None

    def _is_due(self, part: Part, stamp_ns: int) -> bool:
        settings, start_ns = self._settings, part.start_ns
        if start_ns is None:
            return False
        full = 0.0 < settings.split_size * MB <= part.size
        return full or 0.0 < settings.split_duration <= seconds_between(start_ns, stamp_ns)

    def _check_disk(self) -> None:
        free, least = shutil.disk_usage(self._folder).free, self._settings.min_free
        if free < least * MB:
            raise DiskFullError(
                f'{free / MB:.0f} MB are free where {self._folder} is, {least:g} MB must stay '
                'free; make space, or lower min_free'
            )

    def _describe(self) -> None:
        messages = self._settings.compression != 'none' and self._settings.storage == 'sqlite3'
        content = metadata.document(
            self.completed, self._settings.storage, 'message' if messages else ''
        )
        metadata.write(self._folder, content)


def make_folder(folder: Path) -> None:
    """Make the folder of a new bag, or raise InputError."""
    try:
        folder.mkdir(parents=True)
    except FileExistsError:
        raise InputError(f'{folder} exists already; name another bag') from None
    except OSError as error:
        raise InputError(f'{folder}: bag cannot be written: {error.strerror}') from None
