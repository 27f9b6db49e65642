"""Late start: a recording that began while tracker or servo were at work already."""

import math

from visual_servo_epipolar import __version__
from visual_servo_epipolar.bags.reading.bag import Bag
from visual_servo_epipolar.bags.reading.run import Key, Recording, StampSequence
from visual_servo_epipolar.bags.replaying.replay import value_at, with_recorded
from visual_servo_epipolar.core.cameras.model import CameraModel
from visual_servo_epipolar.core.laws.law import DEFAULT_LAW
from visual_servo_epipolar.core.laws.registry import law_named, machine_of
from visual_servo_epipolar.core.perception.observation import observe
from visual_servo_epipolar.core.servo.settings import ServoSettings
from visual_servo_epipolar.core.servo.state import ServoState
from visual_servo_epipolar.core.servo.step import step
from visual_servo_epipolar.core.servo.telemetry import telemetry
from visual_servo_epipolar.core.tracking.features import Features
from visual_servo_epipolar.messages import validation

CLOSE = 1e-6  # what other arithmetic may make of one step
TRACKER = (
    'the recording began after the tracker: what it had seen before is unknown, so that replayed '
    'images may give other tracks; --tracks replays those that were recorded'
)
SERVO = (
    'the recording began after the servo had started: its state is unknown, so that the replay '
    'begins anew and its commands differ; start the recorder before the servo'
)


def late_start_notes(
    bag: Bag, run: Recording, settings: ServoSettings | None, *, from_tracks: bool
) -> list[str]:
    """Return notes on what was at work before; ``settings`` are of the first step, if any."""
    notes = []
    if run.first_age and not from_tracks:
        notes.append(TRACKER)
    if run.telemetry and _is_servo_at_work(bag, run, settings, min(run.telemetry)):
        notes.append(SERVO)
    return notes


def _is_servo_at_work(
    bag: Bag, run: Recording, settings: ServoSettings | None, first: Key
) -> bool:
    """Return whether a servo that begins would not have done the first step that is recorded."""
    phase = run.diagnoses.get(first[0], {}).get('phase')
    machine = machine_of(law_named(DEFAULT_LAW)) if settings is None else settings.machine
    if phase is not None and phase not in {item.value for item in machine.first_phases}:
        return True
    same_version = all(item.version in ('', __version__) for _, item in run.servo)
    cameras = run.cameras_of()
    camera = value_at(cameras, first[0]) if cameras else ''
    if settings is None or isinstance(camera, str) or not same_version:
        return False
    features = _first_features(bag, run, first, camera)
    if features is None:
        return False
    observation = observe(features, camera, first[0])
    observation = with_recorded(observation, run.telemetry[first], settings)
    state = step(ServoState(), observation, settings)
    return not _is_close(telemetry(state), run.telemetry[first])


def _first_features(bag: Bag, run: Recording, first: Key, camera: CameraModel) -> Features | None:
    """Return the recorded tracks of the first step, as the servo takes them."""
    if 'tracks' not in run.topics:
        return None
    topic = run.topics['tracks']
    sequence = StampSequence(bag.path, topic)
    for item in bag.messages([topic.name]):
        if sequence.key(item) == first:
            return validation.checked_tracks(item.message, camera)[0]
    return None


def _is_close(a: dict[str, float], b: dict[str, float]) -> bool:
    return all(
        math.isclose(a[name], b[name], rel_tol=CLOSE, abs_tol=CLOSE)
        or (math.isnan(a[name]) and math.isnan(b[name]))
        for name in a.keys() & b.keys()
    )
