"""
Replay: a recorded run through tracker and servo, with its own parameters or others.

No clock and no ROS: it runs as fast as the machine allows, and deterministically. The robot moves
as recorded: the replay shows what the servo would have commanded.
"""

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
import math
from typing import Any, TypeVar

from visual_servo_epipolar.bags.reading.bag import Bag, RecordedMessage
from visual_servo_epipolar.bags.reading.run import (
    EventQueue,
    History,
    in_force,
    Key,
    Recording,
    StampSequence,
)
from visual_servo_epipolar.core.arrays import Image
from visual_servo_epipolar.core.cameras.model import CameraModel
from visual_servo_epipolar.core.errors import InputError, TrackingError
from visual_servo_epipolar.core.geometry.motion import DESIRED_POSE
from visual_servo_epipolar.core.laws.phase import Phase
from visual_servo_epipolar.core.servo.run import Interruption, Run
from visual_servo_epipolar.core.servo.run_log import MotionLimits, RunLog, SETTLE_FRAMES, summarise
from visual_servo_epipolar.core.servo.settings import ServoSettings
from visual_servo_epipolar.core.servo.telemetry import (
    joints_of,
    odometry_of,
    sample,
    SINCE_COMMAND,
    telemetry,
)
from visual_servo_epipolar.core.tracking.features import Features
from visual_servo_epipolar.core.tracking.settings import TrackerSettings
from visual_servo_epipolar.core.tracking.tracker import Tracker
from visual_servo_epipolar.core.twoview.observation import Observation, observe
from visual_servo_epipolar.messages import read, validation
from visual_servo_epipolar.messages.event_log import Entry, REDETECTED
from visual_servo_epipolar.messages.tracking import track

T = TypeVar('T')


@dataclass(frozen=True, kw_only=True)
class Plan:
    """Plan of a replay: tracks or images; histories of settings, cameras, photographs."""

    from_tracks: bool
    servo: History[ServoSettings]
    tracker: History[TrackerSettings]
    cameras: History[CameraModel | str]
    photographs: History[Image] = ()


@dataclass(frozen=True, slots=True, eq=False)
class TrackedImage:
    """Image and the features tracked in it; None for the image in a replay of tracks."""

    key: Key
    log_ns: int
    camera: CameraModel | str
    features: Features
    image: Image | None = None
    warning: str = ''
    goal: int | None = None


@dataclass(frozen=True, slots=True)
class ReplayedStep:
    """Step of the servo in a replay: its phase, the reason for it, its telemetry."""

    key: Key
    log_ns: int
    phase: Phase
    reason: str
    telemetry: Mapping[str, float]


Watch = Callable[[ReplayedStep], None]


def replay(
    bag: Bag, run: Recording, plan: Plan, *, watch: Watch | None = None
) -> list[ReplayedStep]:
    """
    Run tracker and servo on the recorded inputs, and return each step.

    Images and tracks that the nodes dropped, by what else is in the bag, are left out. ``watch``
    is called after each step.

    Raises InputError if the bag is damaged, time jumps, or nothing in it can be used.
    """
    servo, steps, refusal = Run(), list[ReplayedStep](), ''
    events = EventQueue(run.servo_events)
    for tracked in tracked_images(bag, run, plan):
        if isinstance(tracked.camera, str):
            refusal = f'camera_info cannot be used: {tracked.camera}'
            continue
        if run.telemetry and tracked.key not in run.telemetry:
            continue  # the servo was not started
        for entry in events.due(tracked.key[0]):
            servo = _after(servo, entry)
        camera = tracked.camera
        servo = servo.with_camera(camera)
        features, foreign = servo.admitted(tracked.features, tracked.goal, camera)
        if foreign:
            tracked = replace(tracked, features=features, warning=foreign)
        recorded = run.telemetry.get(tracked.key, {})
        settings = value_at(plan.servo, tracked.key[0])
        observation = observe(features, camera, tracked.key[0])
        observation = with_recorded(observation, recorded, settings)
        servo = servo.decide(
            observation,
            settings,
            goal=features.goal,
            since_command=recorded.get(SINCE_COMMAND, math.nan),
            trouble=foreign,
        ).update_map()
        state = servo.state
        outcome = ReplayedStep(
            tracked.key, tracked.log_ns, state.phase, state.reason, telemetry(state)
        )
        steps.append(outcome)
        refusal = refusal or (tracked.warning if not len(tracked.features) else '')
        if watch is not None:
            watch(outcome)
    if not any(item.telemetry['features'] for item in steps):
        raise InputError(f'{bag.path}: nothing in it can be used: {refusal or "it is empty"}')
    return steps


def with_recorded(
    observation: Observation, recorded: Mapping[str, float], settings: ServoSettings
) -> Observation:
    """Return ``observation`` with what a telemetry has of wheels and joints at its image."""
    observation = replace(observation, odometry=odometry_of(recorded))
    joints = joints_of(recorded)
    if joints is None or settings.carrier.turn_rate == 0.0:
        return observation
    return observation.on_rig(settings.carrier, joints)


def tracked_images(bag: Bag, run: Recording, plan: Plan) -> Iterator[TrackedImage]:
    """Yield each image with its features: those recorded, or tracked anew."""
    topic = run.topics['tracks' if plan.from_tracks else 'image']
    sequence = StampSequence(bag.path, topic)
    track = (
        _from_recorded_tracks
        if plan.from_tracks
        else ReplayTracker(plan, EventQueue(run.tracker_events)).track
    )
    for item in bag.messages([topic.name]):
        key = sequence.key(item)
        if not plan.from_tracks and run.tracked and key not in run.tracked:
            continue  # an image that the tracker dropped
        yield track(item, key, value_at(plan.cameras, key[0]))


class ReplayTracker:
    """Tracker with the settings, photographs and events of the recorded one, in their time."""

    def __init__(self, plan: Plan, events: EventQueue) -> None:
        self._plan, self._tracker, self._events = plan, Tracker(plan.tracker[0][1]), events
        self._photograph: Image | None = None

    def track(self, item: RecordedMessage, key: Key, camera: CameraModel | str) -> TrackedImage:
        """Track features in the next image."""
        self._tracker.settings = value_at(self._plan.tracker, key[0])
        photograph = in_force(self._plan.photographs, key[0])
        if photograph is not None and photograph is not self._photograph:
            self._set_desired(photograph)
        for entry in self._events.due(key[0]):
            if entry.event == REDETECTED:
                self._tracker.redetect()
        result = track(self._tracker, item.message, camera)
        features, warning = result.features, result.warning
        if not isinstance(camera, str):
            features, untrusted = validation.checked_features(features, camera)
            warning = untrusted or warning
        goal = self._tracker.goal.id or None
        return TrackedImage(key, item.log_ns, camera, features, result.image, warning, goal)

    def _set_desired(self, photograph: Image) -> None:
        self._photograph = photograph
        try:
            self._tracker.set_desired(photograph)
        except (ValueError, TrackingError) as error:
            raise InputError(f'the desired image cannot be used: {error}') from None


def _after(servo: Run, entry: Entry) -> Run:
    try:
        return servo.interrupted(Interruption(entry.event), entry.reason)
    except ValueError:
        return servo  # an event of a later version


def _from_recorded_tracks(
    item: RecordedMessage, key: Key, camera: CameraModel | str
) -> TrackedImage:
    if isinstance(camera, str):
        return TrackedImage(key, item.log_ns, camera, Features())
    features, warning = validation.checked_tracks(item.message, camera)
    goal = read.goal(item.message)
    return TrackedImage(key, item.log_ns, camera, features, None, warning, goal)


def value_at(history: History[T], stamp_ns: int) -> T:
    """Return the value in force for an image of ``stamp_ns``: the first one before any."""
    value = in_force(history, stamp_ns)
    return history[0][1] if value is None else value


FROM_TRUTH = (
    'start',
    'position_error_m',
    'lateral_error_m',
    'longitudinal_error_m',
    'heading_error_deg',
    'path_length_m',
    'max_distance_ratio',
    'standstills',
    'standing_s',
    'least_time_s',
    'time_ratio',
)


def has_truth(run: Recording, steps: Sequence[ReplayedStep]) -> bool:
    """Return whether ground truth was recorded for every step."""
    return all(step.key[0] in run.poses for step in steps)


def driven(steps: Sequence[ReplayedStep]) -> Sequence[ReplayedStep]:
    """Return the steps to the end of the run, with some more in which the base brakes."""
    phase, count = steps[-1].phase, len(steps)
    if not phase.ended:
        return steps
    while count and steps[count - 1].phase is phase:
        count -= 1
    return steps[: count + SETTLE_FRAMES]


def run_log(
    run: Recording,
    steps: Sequence[ReplayedStep],
    *,
    seed: int,
    law: str,
    limits: MotionLimits | None = None,
) -> RunLog:
    """Return the replay up to its end as a record; without ground truth poses are the goal's."""
    steps = driven(steps)
    poses = [run.poses.get(step.key[0], DESIRED_POSE) for step in steps]
    samples = tuple(
        sample(step.key[0], pose, step.phase, step.telemetry)
        for step, pose in zip(steps, poses, strict=True)
    )
    last = steps[-1]
    reason = last.reason
    if not last.phase.ended:
        reason = f'the bag ends in {last.phase.value}' + (f': {reason}' if reason else '')
    return RunLog(
        # As users give it, without the rounding of a quaternion.
        (poses[0].x, poses[0].y, round(math.degrees(poses[0].heading_error), 9) + 0.0),
        seed,
        samples,
        'arrived' if last.phase is Phase.ARRIVED else 'failed',
        reason,
        int(last.telemetry['attempt']),
        law,
        limits,
    )


def record(run: Recording, steps: Sequence[ReplayedStep], plan: Plan) -> RunLog:
    """Return the replay by a ``plan`` as a record, with law and limits of its last settings."""
    servo = plan.servo[-1][1]
    limits = MotionLimits.of(servo)
    return run_log(run, steps, seed=servo.seed, law=servo.law, limits=limits)


def document(log: RunLog, *, truth: bool) -> dict[str, Any]:
    """Return the run JSON; what only ground truth could tell is null where there is none."""
    result = summarise(log)
    return result if truth else {**result, **dict.fromkeys(FROM_TRUTH)}
