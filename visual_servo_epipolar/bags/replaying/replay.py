"""
A recorded run through the very same tracker and servo, with its own parameters or others.

No clock and no ROS: it runs as fast as the machine allows, and twice the same. What the robot does
is what it did then: the replay shows what the servo would have made of it.
"""

from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass
from typing import TypeVar

from visual_servo_epipolar.bags.reading.bag import Bag, Recorded
from visual_servo_epipolar.bags.reading.run import Events, History, in_force, Key, Order, Recording
from visual_servo_epipolar.core.arrays import Image
from visual_servo_epipolar.core.errors import InputError, TrackingError
from visual_servo_epipolar.core.geometry.camera import Camera
from visual_servo_epipolar.core.perception.perceive import observe
from visual_servo_epipolar.core.servo.interruptions import interrupted, Interruption
from visual_servo_epipolar.core.servo.phases.table import Phase
from visual_servo_epipolar.core.servo.settings import ServoSettings
from visual_servo_epipolar.core.servo.state import ServoState
from visual_servo_epipolar.core.servo.step import step
from visual_servo_epipolar.core.servo.telemetry import telemetry
from visual_servo_epipolar.core.tracking.features import Features
from visual_servo_epipolar.core.tracking.settings import TrackerSettings
from visual_servo_epipolar.core.tracking.tracker import Tracker
from visual_servo_epipolar.messages import intake
from visual_servo_epipolar.messages.event_log import Entry, REDETECTED

T = TypeVar('T')


@dataclass(frozen=True, kw_only=True)
class Plan:
    """
    What is replayed: from tracks or images, with which settings, camera and photographs.

    All are histories, for they may have been changed while the robot drove.
    """

    from_tracks: bool
    servo: History[ServoSettings]
    tracker: History[TrackerSettings]
    cameras: History[Camera | str]
    photographs: History[Image] = ()


@dataclass(frozen=True, slots=True, eq=False)
class Sighting:
    """What came out of one image: its features, the image itself where there is one."""

    key: Key
    log_ns: int
    camera: Camera | str
    features: Features
    image: Image | None = None
    complaint: str = ''


@dataclass(frozen=True, slots=True)
class Step:
    """One step of the servo: its telemetry, its phase, the reason for it."""

    key: Key
    log_ns: int
    phase: Phase
    reason: str
    numbers: Mapping[str, float]


Watch = Callable[[Step, Sighting], None]


def replay(bag: Bag, run: Recording, plan: Plan, *, watch: Watch | None = None) -> list[Step]:
    """
    Let tracker and servo see what they saw, and return each step.

    Where the bag says what tracker and servo took in, they are given just that. ``watch`` is
    called after each step.

    Raises
    ------
    InputError
        If the bag is damaged, time jumps, or nothing in it can be used.

    """
    state, steps, refused = ServoState(), list[Step](), ''
    events = Events(run.servo_events)
    for seen in sightings(bag, run, plan):
        if isinstance(seen.camera, str):
            refused = f'camera_info cannot be used: {seen.camera}'
            continue
        if run.numbers and seen.key not in run.numbers:
            continue  # the servo was not started
        for entry in events.due(seen.key[0]):
            state = _after(state, entry)
        observation = observe(seen.features, seen.camera, seen.key[0])
        state = step(state, observation, held(plan.servo, seen.key[0]))
        done = Step(seen.key, seen.log_ns, state.phase, state.reason, telemetry(state))
        steps.append(done)
        refused = refused or (seen.complaint if not len(seen.features) else '')
        if watch is not None:
            watch(done, seen)
    if not any(item.numbers['features'] for item in steps):
        raise InputError(f'{bag.path}: nothing in it can be used: {refused or "it is empty"}')
    return steps


def sightings(bag: Bag, run: Recording, plan: Plan) -> Iterator[Sighting]:
    """Yield the features of each image: as they were tracked then, or tracked now."""
    topic = run.topics['tracks' if plan.from_tracks else 'image']
    order = Order(bag.path, topic)
    see = _as_tracked if plan.from_tracks else Eye(plan, Events(run.tracker_events)).see
    for item in bag.messages([topic.name]):
        key = order.key(item)
        if not plan.from_tracks and run.tracked and key not in run.tracked:
            continue  # an image that the tracker dropped
        yield see(item, key, held(plan.cameras, key[0]))


class Eye:
    """A tracker that is told what the one of the run was told, when it was told."""

    def __init__(self, plan: Plan, events: Events) -> None:
        self._plan, self._tracker, self._events = plan, Tracker(plan.tracker[0][1]), events
        self._photograph: Image | None = None

    def see(self, item: Recorded, key: Key, camera: Camera | str) -> Sighting:
        """Track features in the next image."""
        self._tracker.settings = held(self._plan.tracker, key[0])
        photograph = in_force(self._plan.photographs, key[0])
        if photograph is not None and photograph is not self._photograph:
            self._take(photograph)
        for entry in self._events.due(key[0]):
            if entry.event == REDETECTED:
                self._tracker.redetect()
        found = intake.track(self._tracker, item.message, camera)
        features, complaint = found.features, found.complaint
        if not isinstance(camera, str):
            features, untrusted = intake.believed(features, camera)
            complaint = untrusted or complaint
        return Sighting(key, item.log_ns, camera, features, found.image, complaint)

    def _take(self, photograph: Image) -> None:
        self._photograph = photograph
        try:
            self._tracker.set_desired(photograph)
        except (ValueError, TrackingError) as error:
            raise InputError(f'the desired image cannot be used: {error}') from None


def _after(state: ServoState, entry: Entry) -> ServoState:
    try:
        return interrupted(state, Interruption(entry.event), entry.reason)
    except ValueError:
        return state  # of a servo that knows more than this one


def _as_tracked(item: Recorded, key: Key, camera: Camera | str) -> Sighting:
    if isinstance(camera, str):
        return Sighting(key, item.log_ns, camera, Features())
    features, complaint = intake.tracks(item.message, camera)
    return Sighting(key, item.log_ns, camera, features, None, complaint)


def held(history: History[T], stamp_ns: int) -> T:
    """Return what is in force for an image of ``stamp_ns``: before the first it is the first."""
    found = in_force(history, stamp_ns)
    return history[0][1] if found is None else found
