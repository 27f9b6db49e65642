"""Recording of a run: all that a bag holds of it but images, which are streamed."""

from collections import Counter, deque
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager, suppress
from dataclasses import dataclass, field
from itertools import product
from pathlib import Path
from typing import TypeVar

from visual_servo_epipolar.bags.reading.bag import Bag, BagTopic, RecordedMessage
from visual_servo_epipolar.core.arrays import Image
from visual_servo_epipolar.core.cameras.model import CameraModel
from visual_servo_epipolar.core.errors import InputError
from visual_servo_epipolar.core.geometry.motion import Pose, Twist
from visual_servo_epipolar.core.laws.phase import unarmed
from visual_servo_epipolar.core.stamps import NANOSECONDS, seconds_between
from visual_servo_epipolar.messages import event_log, read
from visual_servo_epipolar.messages.event_log import Entry
from visual_servo_epipolar.messages.settings_text import from_text, NodeSettings

T = TypeVar('T')
Key = tuple[int, int]  # stamp [ns], and how many messages of the topic had it before
History = Sequence[tuple[int | None, T]]  # in force after a stamp [ns]; None: from the beginning

MAX_GAP_S = 3600.0


@dataclass(frozen=True, slots=True)
class RecordedTwist:
    """Velocity command as recorded; ``stamp_ns`` is None where the type has none."""

    log_ns: int
    stamp_ns: int | None
    twist: Twist


@dataclass(kw_only=True)
class Recording:
    """
    Recording of a run: inputs of the nodes, telemetry of the servo, ground truth.

    ``tracked`` and ``telemetry`` are empty where tracker or servo was not recorded; ``telemetry``
    is by step, ``diagnoses`` holds phase and reason by stamp. Instead of a camera that cannot be
    used there is the reason; all are there for images that are rectified, or cropped, or not.
    """

    topics: Mapping[str, BagTopic]
    namespace: str | None = None
    cameras: dict[tuple[bool, bool], list[tuple[int | None, CameraModel | str]]] = field(
        default_factory=lambda: {kind: [] for kind in product((False, True), (False, True))}
    )
    photographs: list[tuple[int | None, Image]] = field(default_factory=list)
    tracker: list[tuple[int | None, NodeSettings]] = field(default_factory=list)
    servo: list[tuple[int | None, NodeSettings]] = field(default_factory=list)
    tracker_events: list[Entry] = field(default_factory=list)
    servo_events: list[Entry] = field(default_factory=list)
    tracked: set[Key] = field(default_factory=set)
    first_age: int | None = None  # of a feature in the first tracks that have any [frames]
    telemetry: dict[Key, dict[str, float]] = field(default_factory=dict)
    diagnoses: dict[int, dict[str, str]] = field(default_factory=dict)
    commands: list[RecordedTwist] = field(default_factory=list)
    poses: dict[int, Pose] = field(default_factory=dict)

    def cameras_of(
        self, *, rectified: bool = False, cropped: bool = False
    ) -> list[tuple[int | None, CameraModel | str]]:
        """Return the cameras of images that are as this says, or as the nodes were configured."""
        return self.cameras[
            rectified or self._was_configured('rectified'),
            cropped or self._was_configured('cropped'),
        ]

    def _was_configured(self, name: str) -> bool:
        nodes = (*self.servo[-1:], *self.tracker[-1:])
        return any(settings.values.get(name) is True for _, settings in nodes)


class StampSequence:
    """Sequence of stamps of a topic: they must advance; messages of one stamp are numbered."""

    def __init__(self, path: Path, topic: BagTopic) -> None:
        self._where, self._counts = f'{path}: stamps of {topic.name}', Counter[int]()
        self._last: int | None = None

    def key(self, item: RecordedMessage) -> Key:
        """Return the key of the next message; raises InputError where time jumps."""
        stamp_ns, last = read.stamp_ns(item.message.header), self._last
        if last is not None and not 0.0 <= seconds_between(last, stamp_ns) <= MAX_GAP_S:
            raise InputError(
                f'{self._where} must not run backwards or leap by more than {MAX_GAP_S:g} s, got '
                f'{stamp_ns / NANOSECONDS:.3f} s after {last / NANOSECONDS:.3f} s; a clock was '
                'set while recording: cut the bag there'
            )
        self._last, number = stamp_ns, self._counts[stamp_ns]
        self._counts[stamp_ns] += 1
        return stamp_ns, number


class EventQueue:
    """Queue of the events of a node, each due before the first image after its stamp."""

    def __init__(self, entries: Sequence[Entry]) -> None:
        self._pending = deque(entries)

    def due(self, stamp_ns: int) -> Iterator[Entry]:
        """Yield what happened before the image of ``stamp_ns``."""
        while self._pending:
            after_ns = self._pending[0].after_stamp_ns
            if after_ns is not None and after_ns >= stamp_ns:
                return
            yield self._pending.popleft()


def in_force(history: History[T], stamp_ns: int) -> T | None:
    """Return the value in force for an image of ``stamp_ns``; None before the first."""
    latest = None
    for after_ns, value in history:
        if after_ns is None or after_ns < stamp_ns:
            latest = value
    return latest


@contextmanager
def usable(path: Path, item: RecordedMessage) -> Iterator[None]:
    """Turn a message that cannot be used into an InputError that names it."""
    try:
        yield
    except ValueError as error:
        raise InputError(f'{path}: a message of {item.topic} cannot be used: {error}') from None


def image_size(bag: Bag, topics: Mapping[str, BagTopic]) -> tuple[int, int] | None:
    """Return the size of the images of the bag [px]; None where it has none."""
    topic = topics.get('image')
    item = None if topic is None else next(iter(bag.messages([topic.name])), None)
    if item is None:
        return None
    with usable(bag.path, item):
        height, width = read.gray(item.message).shape
    return width, height


def read_run(bag: Bag, topics: Mapping[str, BagTopic], namespace: str | None = None) -> Recording:
    """Read all but images, of nodes in ``namespace``; raises InputError for unusable ones."""
    run = Recording(topics=topics, namespace=namespace)
    readers = {topics[role].name: reader for role, reader in READERS.items() if role in topics}
    sequences = {
        topics[role].name: StampSequence(bag.path, topics[role])
        for role in ORDERED
        if role in topics
    }
    for item in bag.messages(readers.keys()):
        with usable(bag.path, item):
            sequence = sequences.get(item.topic)
            readers[item.topic](run, item, (0, 0) if sequence is None else sequence.key(item))
    return run


def _read_camera(run: Recording, item: RecordedMessage, key: Key) -> None:
    # A camera_info has the stamp of its image, so it is in force from just before.
    after_ns = read.stamp_ns(item.message.header) - 1
    for (rectified, cropped), cameras in run.cameras.items():
        camera: CameraModel | str
        try:
            camera = read.camera(item.message, rectified=rectified, cropped=cropped)
        except ValueError as error:
            camera = str(error)
        if not cameras or cameras[-1][1] != camera:
            cameras.append((after_ns if cameras else None, camera))


def _read_photograph(run: Recording, item: RecordedMessage, key: Key) -> None:
    # The tracker states the stamp of the last image before, 0 if there was none.
    after_ns = read.stamp_ns(item.message.header) or None
    run.photographs.append((after_ns, read.gray(item.message)))


def _settings(item: RecordedMessage) -> tuple[int | None, NodeSettings]:
    settings = from_text(item.message.data)
    return settings.after_stamp_ns, settings


def _read_tracks(run: Recording, item: RecordedMessage, key: Key) -> None:
    run.tracked.add(key)
    if run.first_age is None and item.message.width:
        with suppress(ValueError):  # tracks that are refused, by the servo as well
            features = read.features(item.message)
            if len(features):  # of the photograph
                run.first_age = int(features.ages.max())


def _read_diagnosis(run: Recording, item: RecordedMessage, key: Key) -> None:
    if not item.message.status:
        return
    if run.namespace not in (None, item.message.status[0].name.rpartition('/')[0]):
        return
    diagnosis = read.diagnosis(item.message)
    if read.is_of_step(diagnosis):
        diagnosis['phase'] = unarmed(diagnosis['phase'])  # as in a replay
        run.diagnoses[read.stamp_ns(item.message.header)] = diagnosis


def _read_command(run: Recording, item: RecordedMessage, key: Key) -> None:
    header = getattr(item.message, 'header', None)
    stamp_ns = None if header is None else read.stamp_ns(header)
    run.commands.append(RecordedTwist(item.log_ns, stamp_ns, read.twist(item.message)))


ORDERED = ('tracks', 'epipoles', 'ground_truth')
READERS: Mapping[str, Callable[[Recording, RecordedMessage, Key], None]] = {
    'camera_info': _read_camera,
    'desired': _read_photograph,
    'tracker_settings': lambda run, item, _: run.tracker.append(_settings(item)),
    'servo_settings': lambda run, item, _: run.servo.append(_settings(item)),
    'tracker_events': lambda run, item, _: run.tracker_events.append(
        event_log.from_text(item.message.data)
    ),
    'servo_events': lambda run, item, _: run.servo_events.append(
        event_log.from_text(item.message.data)
    ),
    'tracks': _read_tracks,
    'epipoles': lambda run, item, key: run.telemetry.update({key: read.telemetry(item.message)}),
    'diagnostics': _read_diagnosis,
    'cmd_vel': _read_command,
    'ground_truth': lambda run, item, key: run.poses.update({key[0]: read.pose(item.message)}),
}
