"""One run in memory: world, tracker and servo in one loop, its end, and the verdict on it."""

from collections.abc import Callable
from dataclasses import dataclass, field, replace
from itertools import pairwise
import math
from typing import Any, Protocol

from visual_servo_epipolar.core.cameras.model import CameraModel
from visual_servo_epipolar.core.geometry.epipolar import Bearings
from visual_servo_epipolar.core.geometry.motion import (
    Pose,
    quaternion_from_yaw,
    STANDSTILL,
    wrap_angle,
    yaw_from_quaternion,
)
from visual_servo_epipolar.core.laws.phase import Phase
from visual_servo_epipolar.core.rigs.rig import AT_REST, Command
from visual_servo_epipolar.core.servo.run import Run
from visual_servo_epipolar.core.servo.run_log import (
    MotionLimits,
    RunLog,
    Sample,
    SETTLE_FRAMES,
    summarise,
)
from visual_servo_epipolar.core.servo.settings import ServoSettings
from visual_servo_epipolar.core.servo.state import ServoState
from visual_servo_epipolar.core.servo.supervisor import too_few_features
from visual_servo_epipolar.core.servo.telemetry import sample, telemetry
from visual_servo_epipolar.core.stamps import NANOSECONDS, period_ns, seconds_between
from visual_servo_epipolar.core.tracking.features import Features
from visual_servo_epipolar.core.twoview.observation import Observation, observe
from visual_servo_epipolar.simulation.bases import Pioneer, PioneerSettings
from visual_servo_epipolar.simulation.cameras import HeadSettings, SimulatedHead
from visual_servo_epipolar.simulation.rigs import SimulatedRig, upright_view
from visual_servo_epipolar.simulation.sensor import (
    BodyState,
    CameraMotion,
    PoseHistory,
    Receipt,
    STILL,
)


class View(Protocol):
    """What stands between the world and the servo: points, or images and a tracker."""

    def observe(self, pose: Pose, frame: int, motion: CameraMotion = STILL) -> Features:
        """Return the features seen in frame number ``frame``, which began at ``pose``."""


WRONG_BEARING = math.radians(10.0)  # beyond which a geometry is wrong [rad]
LEAST_BASELINE_M = 0.02  # below which bearings mean little


@dataclass(frozen=True, kw_only=True)
class LoopSettings:
    """One run: where it starts, how it is seeded, how long it may take [s], what it sees [rad]."""

    start: tuple[float, float, float]
    seed: int = 0
    frame_rate: float = 11.0
    receipt: Receipt = Receipt()
    max_duration: float = 300.0
    servo: ServoSettings = field(default_factory=ServoSettings)
    base: PioneerSettings = field(default_factory=PioneerSettings)
    head: HeadSettings | None = None
    field_of_view: float | None = None


class RunMonitor:
    """
    Run monitor: keeps the samples of a run, in memory or of nodes, and says when it is over.

    A robot that waits stands: where no features are in view none will come, and the run is over.
    On a real robot somebody may carry it; there the servo waits on.
    """

    def __init__(self, settings: LoopSettings) -> None:
        self.settings = settings
        self.samples: list[Sample] = []
        self._reason, self._attempts, self._braking = '', 1, 0
        self._seen_ns: int | None = None  # when the servo last saw enough, or the run began

    @property
    def done(self) -> bool:
        """Whether the servo ended and the base had time to brake, or time is up."""
        if not self.samples:
            return False
        next_ns = self.samples[-1].stamp_ns + period_ns(self.settings.frame_rate)
        is_late = next_ns >= self.settings.max_duration * NANOSECONDS
        return self._braking >= self._settle_frames or is_late or self.hopeless

    @property
    def hopeless(self) -> bool:
        """Whether the robot stands and has seen too little for as long as a search may last."""
        if self._seen_ns is None:
            return False
        waited = seconds_between(self._seen_ns, self.samples[-1].stamp_ns)
        servo = self.settings.servo
        return waited > servo.holding_timeout + servo.carrier.search_time

    @property
    def _settle_frames(self) -> int:
        """Frames after the end in which the base carries out earlier commands, and brakes."""
        delay = self.settings.base.command_delay
        return max(SETTLE_FRAMES, math.ceil(delay * self.settings.frame_rate) + 3)

    def add(self, sample: Sample, *, reason: str, attempts: int) -> None:
        """Take in one step; what comes after the end is ignored."""
        if self.done:
            return
        self.samples.append(sample)
        self._reason, self._attempts = reason, attempts
        self._braking = self._braking + 1 if sample.phase.ended else 0
        few = sample.features < self.settings.servo.min_features
        if not (few and sample.phase is Phase.WAITING) or self._seen_ns is None:
            self._seen_ns = sample.stamp_ns

    def log(self) -> RunLog:
        """Return the record; a run cut off by time has failed."""
        phase, reason = self.samples[-1].phase, self._reason
        if self.hopeless:
            reason = too_few_features(self.samples[-1].features, self.settings.servo)
        elif not phase.ended:
            cut = f'not arrived within {self.settings.max_duration:g} s, still {phase.value}'
            reason = f'{cut}: {reason}' if reason else cut
        return RunLog(
            self.settings.start,
            self.settings.seed,
            tuple(self.samples),
            'arrived' if phase is Phase.ARRIVED else 'failed',
            reason,
            self._attempts,
            self.settings.servo.law,
            MotionLimits.of(self.settings.servo),
            self.settings.field_of_view,
        )


def verdict(log: RunLog, rig: SimulatedRig) -> dict[str, Any]:
    """Return the verdict on a run: that of ``summarise``, and what only the world can measure."""
    return summarise(log) | {'wrong_geometry_s': wrong_geometry_s(log, rig)}


def wrong_geometry_s(log: RunLog, rig: SimulatedRig) -> float:
    """
    Return the time driven on a geometry more than 10 deg wrong [s].

    That is while the command is no standstill and a bearing of the measurement is so far from that
    between the true cameras of ``rig``, upright; where the baseline is below 2 cm, or the servo
    trusted no bearings, nothing counts.
    """
    time_ns = 0
    for frame, (step, after) in enumerate(pairwise(log.samples)):
        if step.twist != STANDSTILL and _is_wrong(step, rig, frame):
            time_ns += after.stamp_ns - step.stamp_ns
    return time_ns / NANOSECONDS


def _is_wrong(step: Sample, rig: SimulatedRig, frame: int) -> bool:
    view = upright_view(rig, step.pose, frame)
    if view.distance <= LEAST_BASELINE_M or math.isnan(
        step.bearing_current + step.bearing_desired
    ):
        return False
    true = Bearings.from_pose(view)
    errors = step.bearing_current - true.current, step.bearing_desired - true.desired
    return max(abs(wrap_angle(error)) for error in errors) > WRONG_BEARING


Control = Callable[[ServoState, Observation, ServoSettings], ServoState]

TICK_NS = 10**7  # between two places that are kept of a robot whose images come late


def published(pose: Pose) -> Pose:
    """Return ``pose`` as it arrives through a message, where the heading is a quaternion."""
    return Pose(pose.x, pose.y, yaw_from_quaternion(*quaternion_from_yaw(pose.theta)))


class DrivenBase:
    """
    A base that drives from image to image, with the ``head`` on it, if any.

    An image is exposed at ``exposed_at``, received and stamped by ``receipt``; ``frame`` is the
    number of the one that comes next, ``pose`` where the robot is as it comes.
    """

    def __init__(
        self,
        base: Pioneer,
        frame_rate: float,
        receipt: Receipt,
        head: SimulatedHead | None = None,
    ) -> None:
        self.base, self.head, self.frame = base, head, 0
        self.pose = published(base.pose)
        self._period_ns, self._receipt = period_ns(frame_rate), receipt
        self._history, self._exposed_ns = PoseHistory(), base.now_ns
        self._history.add(base.now_ns, self._body)
        self._advance()

    @property
    def now_ns(self) -> int:
        """Time of the next frame, by its stamp."""
        return self.base.now_ns if self._receipt.stamps else self._exposed_ns

    @property
    def exposed_at(self) -> Pose:
        """Where the image was exposed that comes next: where the robot is, unless it is late."""
        return self._history.at(self._exposed_ns).pose

    @property
    def shown(self) -> Pose:
        """Where the robot was as the middle row of that image was read out: what it shows."""
        half_ns = round(0.5 * self._receipt.readout * NANOSECONDS)
        return self._history.at(self._exposed_ns + half_ns).pose

    @property
    def motion(self) -> CameraMotion:
        """CameraMotion of the camera while that image is read out."""
        _, twist, nod = self._history.during(self._exposed_ns, self._receipt.readout)
        return CameraMotion(twist, nod, AT_REST if self.head is None else self.head.joints)

    def drive(self, command: Command) -> None:
        """Obey a ``command`` until the next image is received."""
        self.base.command(command)
        if self.head is not None:
            self.head.command(command.head)
        self.frame += 1
        self._advance()

    @property
    def _body(self) -> BodyState:
        return BodyState(self.pose, self.base.twist, self.base.nodding)

    def _advance(self) -> None:
        """Move until the next image is received: at once the first one, if it is not late."""
        self._exposed_ns += self._period_ns if self.frame else 0
        end_ns, now_ns = self._exposed_ns + self._receipt.delay_ns(self.frame), self.base.now_ns
        if self.frame and self._receipt.stamps:  # one image after the other, however late it was
            end_ns = max(end_ns, now_ns + TICK_NS)
        tick_ns = TICK_NS if end_ns > self._exposed_ns else self._period_ns
        while now_ns < end_ns:
            now_ns = min(now_ns + tick_ns, end_ns)
            self.base.advance(now_ns)
            if self.head is not None:
                self.head.advance(now_ns)
            self.pose = published(self.base.pose)
            self._history.add(now_ns, self._body)


class Loop:
    """
    One closed loop, from the start until the servo ends.

    The order of events is that of the nodes in lockstep: ground truth, image, tracks, command, and
    only then does the base move for one period.
    """

    def __init__(self, settings: LoopSettings, view: View, camera: CameraModel) -> None:
        self.view, self.camera = view, camera
        self.monitor = RunMonitor(settings)
        self._servo = settings.servo
        start, seed = Pose.from_start(*settings.start), settings.seed
        head = None if settings.head is None else SimulatedHead(settings.head, seed=seed)
        base = settings.base.base(start, seed=seed)
        self.driven = DrivenBase(base, settings.frame_rate, settings.receipt, head)
        self._run = Run(camera=camera, started=True)

    def run(
        self, *, watch: Callable[[Sample], None] | None = None, control: Control | None = None
    ) -> RunLog:
        """
        Drive until the servo ends, and return the record.

        ``watch`` is called after each step; another law may stand in for the servo as ``control``.
        """
        while not self.monitor.done:
            self.decide(control)
            taken = self.record()
            if watch is not None:
                watch(taken)
            self.drive()
        return self.monitor.log()

    def decide(self, control: Control | None = None) -> None:
        """Look, and let the servo take it in, or another ``control``."""
        driven = self.driven
        features = self.view.observe(driven.exposed_at, driven.frame, driven.motion)
        seen = self._reckoned(observe(features, self.camera, driven.now_ns))
        if control is not None:
            state = control(self._run.state, seen, self._servo)
            self._run = replace(self._run, state=state)
            return
        self._run = self._run.decide(seen, self._servo, goal=features.goal).update_map()

    def _reckoned(self, observation: Observation) -> Observation:
        """Return ``observation`` with what wheels and joints say where base and head are."""
        head, carrier = self.driven.head, self._servo.carrier
        joints = None if head is None else head.read()
        if carrier.turn_rate > 0.0:
            observation = (
                observation.without_features()
                if joints is None
                else observation.on_rig(carrier, joints)
            )
        if not self._servo.odometry:
            return observation
        return replace(observation, odometry=published(self.driven.base.odometry))

    def record(self) -> Sample:
        """Note the step that was decided."""
        state = self._run.state
        taken = sample(self.driven.now_ns, self.driven.pose, state.phase, telemetry(state))
        self.monitor.add(taken, reason=state.reason, attempts=state.run.attempts)
        return taken

    def drive(self) -> None:
        """Obey for one period."""
        self.driven.drive(self._run.state.command)
