"""Replay of a repetition of a route: the recorded images through the same run, step by step."""

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
import os
from pathlib import Path
from typing import Any, TypeAlias

from visual_servo_epipolar.bags.reading.bag import Bag
from visual_servo_epipolar.bags.reading.run import EventQueue, read_run, usable
from visual_servo_epipolar.bags.reading.topics import assign_roles, camera_notes
from visual_servo_epipolar.bags.replaying.comparison import compare_steps, Comparison, Value
from visual_servo_epipolar.bags.replaying.plan import settings_in_time
from visual_servo_epipolar.bags.replaying.replay import value_at
from visual_servo_epipolar.core.cameras.model import CameraModel
from visual_servo_epipolar.core.cameras.registry import CAMERA_INFO
from visual_servo_epipolar.core.errors import InputError
from visual_servo_epipolar.core.routes.run import RouteRun
from visual_servo_epipolar.core.routes.settings import FollowSettings
from visual_servo_epipolar.core.servo.settings import ServoSettings
from visual_servo_epipolar.messages import event_log, read
from visual_servo_epipolar.messages.event_log import Entry, FAILED, HELD, STARTED, STOPPED, UNSENT
from visual_servo_epipolar.messages.route_folder import read_route, route_hash
from visual_servo_epipolar.messages.route_messages import telemetry
from visual_servo_epipolar.messages.settings_text import from_text, NodeSettings

Changes: TypeAlias = Mapping[str, Mapping[str, Any]]
RunSettings: TypeAlias = tuple[FollowSettings, ServoSettings]
STRING = 'std_msgs/msg/String'


@dataclass(frozen=True, eq=False)
class RecordedRepetition:
    """
    Repetition of a route as its node reported it: ``image`` is the topic that it drove by.

    ``steps`` is what each image led to, by its stamp [ns], with the phase where that is clear.
    Without ``cameras`` in the bag it is the one that taught the route.
    """

    image: str
    cameras: list[tuple[int | None, CameraModel | str]] = field(default_factory=list)
    notes: list[str] = field(default_factory=list)
    settings: list[tuple[int | None, NodeSettings]] = field(default_factory=list)
    events: list[Entry] = field(default_factory=list)
    steps: dict[int, dict[str, Value]] = field(default_factory=dict)

    @property
    def versions(self) -> Mapping[str, str]:
        """The versions that recorded it, of this package and of what it computes with."""
        return self.settings[-1][1].versions

    def folder(self) -> Path:
        """Return the folder of the route, as the node had it."""
        return Path(os.path.expanduser(str(self.settings[-1][1].values.get('route', ''))))

    def new_run(
        self, folder: Path, entry: Entry, stamp_ns: int, settings: RunSettings
    ) -> RouteRun:
        """Return the run that ``entry`` begins; raises InputError if ``folder`` is another."""
        route = read_route(folder)
        if route_hash(folder) != entry.reason:
            raise InputError(
                f'{folder} is not the route that was repeated, or it was renewed since; give the '
                'folder as it was then: --route FOLDER'
            )
        camera = value_at(self.cameras, stamp_ns) if self.cameras else None
        if isinstance(camera, str):
            raise InputError(f'camera_info cannot be used: {camera}')
        return RouteRun(route, *settings, camera=camera)


def read_repetition(bag: Bag, requested: Mapping[str, str]) -> RecordedRepetition:
    """Return what a ``bag`` holds of repetitions but images; InputError if that is too little."""
    node, topics = _node(bag), assign_roles(bag, requested, roles=('image', 'camera_info'))
    if node is None or 'image' not in topics:
        raise InputError(
            f'{bag.path}: no images and settings of a route_node to replay; record image_raw, '
            'diagnostics, and settings, events and progress of the node'
        )
    recorded = RecordedRepetition(topics['image'].name)
    names = [f'{node}/{what}' for what in ('settings', 'events', 'progress')]
    phases: dict[int, set[str]] = {}
    for item in bag.messages([*names, '/diagnostics']):
        with usable(bag.path, item):
            message = item.message
            if item.topic == names[0]:
                settings = from_text(message.data)
                recorded.settings.append((settings.after_stamp_ns, settings))
            elif item.topic == names[1]:
                recorded.events.append(event_log.from_text(message.data))
            elif item.topic == names[2]:
                recorded.steps[read.stamp_ns(message.header)] = dict(read.telemetry(message))
            elif message.status and message.status[0].name.endswith(node):
                phase = str(read.diagnosis(message).get('phase', ''))
                phases.setdefault(read.stamp_ns(message.header), set()).add(phase)
    if not recorded.steps:
        raise InputError(
            f'{bag.path}: no steps of {node} to compare with; record {names[2]} beside the images'
        )
    values = recorded.settings[-1][1].values if recorded.settings else {}
    if 'camera_info' in topics and values.get('projection', CAMERA_INFO) == CAMERA_INFO:
        recorded.notes.extend(camera_notes(bag, topics, requested))
        run = read_run(bag, {'camera_info': topics['camera_info']})
        kind = {name: values.get(name) is True for name in ('rectified', 'cropped')}
        recorded.cameras.extend(run.cameras_of(**kind))
    for stamp_ns, step in recorded.steps.items():
        if len(phases.get(stamp_ns, ())) == 1:
            step['phase'] = next(iter(phases[stamp_ns]))
    return recorded


def replayed_steps(
    bag: Bag, recorded: RecordedRepetition, folder: Path, changes: Changes
) -> Iterator[tuple[int, dict[str, Value]]]:
    """
    Yield stamp, and phase and telemetry, of each step that the node took, taken once more.

    ``changes`` are settings that are others than recorded, by ``follow`` and ``servo``.

    Raises InputError if the bag begins within a repetition.
    """
    events, left = EventQueue(recorded.events), {*recorded.steps}
    run: RouteRun | None = None
    changed, follow, servo = recorded.settings, changes.get('follow', {}), changes.get('servo', {})
    follows = settings_in_time(FollowSettings(), changed, follow, [])
    servos = settings_in_time(ServoSettings(), changed, servo, [])
    in_force = value_at(follows, 0), value_at(servos, 0)
    for item in bag.messages([recorded.image]):
        with usable(bag.path, item):
            stamp_ns, image = read.stamp_ns(item.message.header), read.gray(item.message)
        if stamp_ns not in left:
            continue  # no command depended on it
        left.remove(stamp_ns)
        before, in_force = in_force, (value_at(follows, stamp_ns), value_at(servos, stamp_ns))
        for entry in events.due(stamp_ns):
            if entry.event == STARTED:
                run, before = recorded.new_run(folder, entry, stamp_ns, in_force), in_force
            else:
                run = _after(run, entry)
        if run is None:
            raise InputError(
                f'{bag.path} begins within a repetition; record from before ~/repeat is called'
            )
        run.prepare()
        if in_force != before:
            run.use(*in_force)
        step = run.step(image, stamp_ns)
        yield stamp_ns, {'phase': step.phase, **telemetry(step)}


def compare_repetition(
    recorded: RecordedRepetition, steps: Mapping[int, Mapping[str, Value]], tolerance: float
) -> Comparison:
    """Compare replayed steps, by stamp, with the recorded ones."""
    result = compare_steps(
        [(stamp_ns, recorded.steps[stamp_ns], step) for stamp_ns, step in steps.items()],
        tolerance,
    )
    result.missing = len(recorded.steps.keys() - steps.keys())
    return result


def _after(run: RouteRun | None, entry: Entry) -> RouteRun | None:
    """Return the run after what happened to it, as the node had it."""
    if run is None or entry.event == STOPPED:
        return None
    if entry.event != UNSENT:  # the node prepares after each step, but after that
        run.prepare()
    if entry.event in (HELD, UNSENT):
        run.halt(entry.at_ns or 0, entry.reason, unsent=entry.event == UNSENT)
    elif entry.event == FAILED:
        run.fail(entry.reason)
    return run


def _node(bag: Bag) -> str | None:
    """Return the name of the node that repeated a route; None if there is none."""
    for topic in bag.topics.values():
        if topic.kind != STRING or not topic.name.endswith('/settings'):
            continue
        for item in bag.messages([topic.name]):
            with usable(bag.path, item):
                if 'steering_length' in from_text(item.message.data).values:
                    return topic.name.removesuffix('/settings')
    return None
