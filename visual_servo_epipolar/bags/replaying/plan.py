"""Planning a replay: what was recorded, with the overrides of the user."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, fields
from typing import Any, TypeVar

from visual_servo_epipolar import __version__
from visual_servo_epipolar.bags.reading.bag import Bag, RecordedMessage
from visual_servo_epipolar.bags.reading.run import Recording, usable
from visual_servo_epipolar.bags.reading.topics import ROLES
from visual_servo_epipolar.bags.replaying.replay import Plan, value_at
from visual_servo_epipolar.core.arrays import Image
from visual_servo_epipolar.core.cameras.model import CameraModel
from visual_servo_epipolar.core.errors import InputError
from visual_servo_epipolar.core.estimate.settings import DEFAULT_LAW
from visual_servo_epipolar.core.laws.registry import LAWS, machine_of
from visual_servo_epipolar.core.servo.settings import ServoSettings
from visual_servo_epipolar.core.settings import Settings, updated
from visual_servo_epipolar.core.stamps import NANOSECONDS
from visual_servo_epipolar.core.tracking.settings import TrackerSettings
from visual_servo_epipolar.files import PACKAGE
from visual_servo_epipolar.messages import read
from visual_servo_epipolar.messages.settings_text import installed_versions, NodeSettings

SettingsT = TypeVar('SettingsT', bound=Settings)
NEAR_NS = NANOSECONDS // 2  # how far from the stamp asked for the photograph may be
TRACKER = (
    'the recording began after the tracker: what it had seen before is unknown, so that replayed '
    'images may give other tracks; --tracks replays those that were recorded'
)
SERVO = (
    'the recording began after the servo had started: its state is unknown, so that the replay '
    'begins anew and its commands differ; start the recorder before the servo'
)


@dataclass(frozen=True, slots=True)
class Moment:
    """Time of an image: its stamp [ns], or the time since the first image [ns]."""

    time_ns: int
    since_first: bool = False


@dataclass(frozen=True, kw_only=True)
class ReplayOverrides:
    """
    Overrides of the user over what was recorded.

    ``rectified`` and ``cropped`` are images even where no recorded setting says so. ``desired`` is
    a photograph, or when it was taken; ``changes`` are settings by section, ``tracker`` and
    ``servo``.
    """

    from_tracks: bool = False
    camera: CameraModel | None = None
    rectified: bool = False
    cropped: bool = False
    desired: Image | Moment | None = None
    changes: Mapping[str, Mapping[str, Any]] = field(default_factory=dict)


def plan(bag: Bag, run: Recording, overrides: ReplayOverrides) -> tuple[Plan, list[str]]:
    """
    Return what to replay with, and notes on what had to be assumed.

    Raises InputError if the bag lacks what is needed, or a setting is not what it may be.
    """
    notes: list[str] = []
    from_tracks = _from_tracks(bag, run, overrides, notes)
    result = Plan(
        from_tracks=from_tracks,
        servo=settings_in_time(
            ServoSettings(), run.servo, overrides.changes.get('servo', {}), notes
        ),
        tracker=settings_in_time(
            TrackerSettings(),
            run.tracker,
            overrides.changes.get('tracker', {}),
            notes,
            unused=('matcher', 'matcher_model') if from_tracks else (),  # they are of images
        ),
        cameras=_cameras(bag, run, overrides),
        photographs=() if from_tracks else _photographs(bag, run, overrides),
    )
    recorded = settings_in_time(ServoSettings(), run.servo, {}, []) if run.telemetry else []
    first = value_at(recorded, min(run.telemetry)[0]) if run.servo and run.telemetry else None
    notes += late_start_notes(run, first, from_tracks=from_tracks)
    return result, notes


def _from_tracks(bag: Bag, run: Recording, overrides: ReplayOverrides, notes: list[str]) -> bool:
    images, tracks = 'image' in run.topics, 'tracks' in run.topics
    has_photograph = bool(run.photographs) or overrides.desired is not None
    if tracks and (overrides.from_tracks or not (images and has_photograph)):
        if not overrides.from_tracks:
            notes.append('the bag has no images with a desired one: recorded tracks are replayed')
        return True
    if overrides.from_tracks or not images:
        source = 'tracks' if overrides.from_tracks else 'images or tracks'
        raise InputError(
            f'{bag.path}: no {source} to replay; it has {", ".join(bag.topics) or "no topics"}: '
            'name one with --topics image=NAME or tracks=NAME'
        )
    if not has_photograph:
        raise InputError(
            f'{bag.path}: no desired image; give a file, or a stamp in the bag, by --desired'
        )
    return False


def settings_in_time(
    default: SettingsT,
    history: Sequence[tuple[int | None, NodeSettings]],
    changes: Mapping[str, Any],
    notes: list[str],
    unused: Sequence[str] = (),
) -> list[tuple[int | None, SettingsT]]:
    """Return the settings in their time, each with ``changes`` in place, without those unused."""
    section = type(default).__name__.removesuffix('Settings').lower()
    # What is changed need not hold any more: a file that is here no longer.
    changed = {default.RENAMED.get(name, name) for name in changes}
    names = {item.name for item in fields(default)}.difference(unused, changed)
    where = section if changes else f'recorded {section}'
    if not history:
        notes.append(f'no parameters of the {section} in the bag: those not given are defaults')
    timeline: list[tuple[int | None, SettingsT]] = []
    try:
        for after_ns, recorded in history:
            values = {name: value for name, value in recorded.values.items() if name in names}
            _note_version(recorded, notes)
            _note_gone(default, recorded, notes)
            timeline.append((after_ns, updated(default, {**values, **changes}, where)))
        return timeline or [(None, updated(default, changes, section))]
    except (TypeError, ValueError) as error:
        raise InputError(str(error)) from None


def _note_gone(settings: Settings, recorded: NodeSettings, notes: list[str]) -> None:
    for name, off in settings.GONE.items():
        note = f'recorded with {name} {recorded.values.get(name)}: this version replays without it'
        if recorded.values.get(name, off) != off and note not in notes:
            notes.append(note)


def _note_version(recorded: NodeSettings, notes: list[str]) -> None:
    new = []
    if recorded.version not in ('', __version__):
        new.append(f'recorded with version {recorded.version}, replayed with {__version__}')
    now = installed_versions()
    differing = {
        name: (version, now[name])
        for name, version in recorded.versions.items()
        if name != PACKAGE and now.get(name, version) != version
    }
    if differing:
        before, after = (
            ', '.join(f'{name} {each[k]}' for name, each in differing.items()) for k in (0, 1)
        )
        new.append(f'recorded with {before}, replayed with {after}')
    notes += [note for note in new if note not in notes]


def _cameras(
    bag: Bag, run: Recording, overrides: ReplayOverrides
) -> Sequence[tuple[int | None, CameraModel | str]]:
    if overrides.camera is not None:
        return [(None, overrides.camera)]
    cameras = run.cameras_of(rectified=overrides.rectified, cropped=overrides.cropped)
    if not cameras:
        raise InputError(
            f'{bag.path}: no camera_info; name its topic with --topics camera_info=NAME, or give '
            'a camera file: --camera FILE.yaml'
        )
    return cameras


def _photographs(
    bag: Bag, run: Recording, overrides: ReplayOverrides
) -> Sequence[tuple[int | None, Image]]:
    if isinstance(overrides.desired, Moment):
        return [(None, _image_at(bag, run, overrides.desired))]
    if overrides.desired is not None:
        return [(None, overrides.desired)]
    if run.topics['desired'].name.endswith(ROLES['desired'].endings[0]):
        return run.photographs
    # Not from the tracker: its time is not recorded, but it was there before the first step.
    return [(None, run.photographs[0][1]), *run.photographs[1:]]


def _image_at(bag: Bag, run: Recording, moment: Moment) -> Image:
    """Return the image of the bag that was taken nearest to ``moment``."""
    best: RecordedMessage | None = None
    first_ns, last_ns, distance_ns, wanted_ns = 0, 0, 0, moment.time_ns
    for number, item in enumerate(bag.messages([run.topics['image'].name])):
        last_ns = read.stamp_ns(item.message.header)
        if number == 0:
            first_ns = last_ns
            wanted_ns += first_ns if moment.since_first else 0
        if best is None or abs(last_ns - wanted_ns) < distance_ns:
            best, distance_ns = item, abs(last_ns - wanted_ns)
    if best is None or distance_ns > NEAR_NS:
        raise InputError(
            f'{bag.path}: no image was taken at {wanted_ns / NANOSECONDS:.3f} s; choose a stamp '
            f'from {first_ns / NANOSECONDS:.3f} s to {last_ns / NANOSECONDS:.3f} s'
        )
    with usable(bag.path, best):
        return read.gray(best.message)


def late_start_notes(
    run: Recording, settings: ServoSettings | None, *, from_tracks: bool
) -> list[str]:
    """Return notes on what was at work before; ``settings`` are of the first step, if any."""
    notes = [TRACKER] if run.first_age and not from_tracks else []
    machine = machine_of(LAWS[DEFAULT_LAW]) if settings is None else settings.machine
    first = min(run.telemetry)[0] if run.telemetry else 0
    phase = run.diagnoses.get(first, {}).get('phase')
    if phase is not None and phase not in {item.value for item in machine.first_phases}:
        notes.append(SERVO)
    return notes
