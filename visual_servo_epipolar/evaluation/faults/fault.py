"""Faults: what each is called, when it strikes, the run that it strikes, and its witness."""

from bisect import bisect_right
from collections.abc import Callable
from dataclasses import dataclass, field
from enum import Enum
from functools import partial
import math
from typing import Any, Concatenate, ParamSpec

import numpy as np
from rclpy.logging import LoggingSeverity
from rclpy.node import Node

from visual_servo_epipolar.core.estimate.map_state import LEAST_CARRIED
from visual_servo_epipolar.core.geometry.motion import Pose, STANDSTILL, Twist
from visual_servo_epipolar.core.laws.phase import ARMED, Phase
from visual_servo_epipolar.core.stamps import NANOSECONDS
from visual_servo_epipolar.evaluation.faults.judge import (
    Record,
    SeenTracks,
    ServoCommand,
    TrueMotion,
)
from visual_servo_epipolar.evaluation.faults.world import (
    Envelope,
    Filter,
    ImageOrigin,
    World,
)
from visual_servo_epipolar.messages import read

SERVO, BASE = 'servo_node', 'unicycle_node'


class Witness:
    """Witness of a ``world``; ``record`` is what it saw up to now."""

    def __init__(self, world: World) -> None:
        self.record, self._world, self._wire = Record(), world, world.wire
        self.struck_ns = 0  # earlier reports explain nothing
        self._image: ImageOrigin | None = None  # the last one that reached the tracker
        listeners = self._wire.publish_listeners
        listeners['/ground_truth'].append(self._on_truth)
        listeners['/image_raw'].append(self._on_image)
        listeners['/tracks'].append(self._on_tracks)
        listeners['/phase'].append(self._on_phase)
        for topic, hear in (
            ('/cmd_vel', self._on_command),
            ('/diagnostics', self._on_diagnostics),
        ):
            listeners[topic].append(partial(self._of_servo, hear))
        self._wire.delivery_listeners['/image_raw'].append(self._on_arrival)
        self._wire.delivery_listeners['/tracks'].append(self._on_sight)

    @property
    def now_s(self) -> float:
        """The time [s]."""
        return self._wire.now_ns / NANOSECONDS

    @property
    def pose(self) -> Pose:
        """Where the robot is: at its start, before the first word of ground truth."""
        truths = self.record.truths
        return truths[-1].pose if truths else Pose.from_start(*self._world.settings.start)

    @property
    def seen_pose(self) -> Pose:
        """Where the image was taken that the tracker had last."""
        if self._image is None:
            return self.pose
        times = [truth.time_s for truth in self.record.truths]
        last = bisect_right(times, self._image.taken_ns / NANOSECONDS) - 1
        return self.record.truths[max(last, 0)].pose

    def finish(self) -> Record:
        """Return the record, with the reports of why the robot stands."""
        record = self.record
        record.crashes = list(self._wire.crashes)
        if record.truths and not self._world.works(BASE):  # without its process it stands
            record.truths.append(TrueMotion(self.now_s, self.pose, STANDSTILL))
        record.why += [
            text
            for time_ns, _, severity, text in self._wire.logs
            if severity >= LoggingSeverity.WARN and time_ns >= self.struck_ns
        ]
        if not self._world.works(SERVO):  # as one that hangs for good, from before it drove
            record.why.append(f'{SERVO} is gone, or hangs')
        if record.stopped_s < math.inf:
            record.why.append('it was commanded to')
        standing = (Phase.HOLDING.value, Phase.FAILED.value, Phase.WAITING.value, ARMED)
        if record.phase in standing and record.reason:
            record.why.append(record.reason)
        return record

    def _of_servo(self, hear: Callable[[Any], None], envelope: Envelope) -> None:
        if envelope.sender == SERVO:
            hear(envelope.message)

    def _on_truth(self, envelope: Envelope) -> None:
        pose, twist = read.pose(envelope.message), read.twist(envelope.message.twist)
        self.record.truths.append(TrueMotion(self.now_s, pose, twist))

    def _on_phase(self, envelope: Envelope) -> None:
        if envelope.sender not in (SERVO, ''):  # '' in its constructor
            return
        before, self.record.phase = self.record.phase, str(envelope.message.data)
        if self.record.phase == Phase.ARRIVED.value != before:
            self.record.arrived_s = self.now_s

    def _on_diagnostics(self, message: Any) -> None:
        self.record.reason = read.diagnosis(message).get('reason', self.record.reason)

    def _on_image(self, envelope: Envelope) -> None:
        envelope.sight = ImageOrigin(self._wire.now_ns)

    def _on_arrival(self, node: Node, envelope: Envelope) -> None:
        self._image = envelope.sight

    def _on_tracks(self, envelope: Envelope) -> None:
        # An image that waited for its camera_info was not what the tracker was called for.
        envelope.sight = envelope.sight or self._image

    def _on_sight(self, node: Node, envelope: Envelope) -> None:
        if node.get_name() != SERVO or envelope.sight is None or not envelope.sight.true:
            return
        if _shown(envelope.message) >= LEAST_CARRIED:
            taken_s = envelope.sight.taken_ns / NANOSECONDS
            self.record.seen.append(SeenTracks(self.now_s, taken_s))

    def _on_command(self, message: Any) -> None:
        servo = self._world.nodes.get(SERVO)
        if servo is None:
            return
        try:
            twist = read.twist(message)
        except ValueError as error:
            self.record.senseless = str(error)
            return
        most = (servo.get_parameter(name).value for name in ('max_linear', 'max_angular'))
        self.record.orders.append(ServoCommand(self.now_s, twist, Twist(*most)))


def _shown(tracks: Any) -> int:
    """Return how many features of the photograph a message of ``tracks`` has."""
    try:
        return len(read.features(tracks))
    except ValueError:
        return int(tracks.width)


class RunStage(str, Enum):
    """Stages of a run: before the first image, on the way, after its end."""

    BEGIN = 'begin'
    DRIVING = 'driving'
    END = 'end'


@dataclass(slots=True)
class StruckRun:
    """The run that a fault strikes: its world, its witness, chance; ``notes`` say what is done."""

    world: World
    witness: Witness
    rng: np.random.Generator
    notes: list[str] = field(default_factory=list)
    busy_s: float = 0.0  # until then something is to happen

    def draw(self, low: float, high: float) -> float:
        """Draw a number between ``low`` and ``high``."""
        return float(self.rng.uniform(low, high))

    def hits(self, share: float) -> bool:
        """Draw whether one of a ``share`` is hit."""
        return bool(self.rng.random() < share)

    def later(self, seconds: float, act: Callable[[], object]) -> None:
        """Let ``act`` happen in ``seconds`` from now."""
        wire = self.world.wire
        self.busy_s = max(self.busy_s, self.witness.now_s + seconds)
        wire.at(wire.now_ns + round(seconds * NANOSECONDS), act)

    def filter(self, topic: str, change: Filter, spell: tuple[float, float] | None) -> None:
        """Let messages of ``topic`` go through ``change``, for a ``spell`` [s] or for good."""
        filters, seconds = self.world.wire.filters[topic], math.inf
        filters.append(change)
        if spell is not None:
            seconds = self.spell(*spell)
        if seconds < math.inf:
            self.later(seconds, lambda: filters.remove(change))

    def note_stop(self) -> None:
        """Note that the robot is commanded now to stand for good."""
        self.witness.record.stopped_s = self.witness.now_s

    def spell(self, low: float, high: float) -> float:
        """Draw how long something lasts [s], and note it; half of the time it is for good."""
        seconds = math.inf if self.hits(0.5) else self.draw(low, high)
        self.notes.append('for good' if seconds == math.inf else f'for {seconds:.1f} s')
        return seconds


Strike = Callable[[StruckRun], object]
What = ParamSpec('What')


def striking(act: Callable[Concatenate[StruckRun, What], object]) -> Callable[What, Strike]:
    """Return what makes strikes that ``act`` on a scene, from the other arguments of ``act``."""

    def strike_with(*what: What.args, **more: What.kwargs) -> Strike:
        return lambda scene: act(scene, *what, **more)

    return strike_with


Change = Callable[[Any, StruckRun], object]


@dataclass(frozen=True)
class Fault:
    """
    A fault: ``strike`` does it to a scene, in one of the ``stages`` and some time into it.

    Where the servo cannot be heard, as ``base_alone`` says, the base must stop by itself;
    elsewhere it may be one that does not.
    """

    what: str
    strike: Strike = lambda scene: None
    stages: tuple[RunStage, ...] = (RunStage.DRIVING,)
    base_alone: bool = False


def driving(what: str, *ways: Strike, **more: Any) -> Fault:
    """Return a fault that strikes a robot that drives, in one of ``ways``, which is drawn."""

    def strike(scene: StruckRun) -> None:
        number = int(scene.rng.integers(len(ways))) if len(ways) > 1 else 0
        if len(ways) > 1:
            scene.notes.append(f'way {number + 1} of {len(ways)}')
        for way in ways[number : number + 1]:
            way(scene)

    return Fault(what, strike, **more)
