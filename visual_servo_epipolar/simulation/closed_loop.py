"""One run in memory: world, tracker and servo in one loop, without ROS and without a clock."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field

import numpy as np

from visual_servo_epipolar.core.geometry.camera import Camera
from visual_servo_epipolar.core.geometry.motion import (
    Pose,
    quaternion_from_yaw,
    yaw_from_quaternion,
)
from visual_servo_epipolar.core.perception.batch import perceive_each, RobotView
from visual_servo_epipolar.core.perception.observation import Observation, observe, observe_each
from visual_servo_epipolar.core.perception.perceive import Perception
from visual_servo_epipolar.core.servo.phases.switch import too_few_features
from visual_servo_epipolar.core.servo.phases.table import ENDED, Phase
from visual_servo_epipolar.core.servo.run_log import RunLog, Sample
from visual_servo_epipolar.core.servo.settings import ServoSettings
from visual_servo_epipolar.core.servo.state import ServoState
from visual_servo_epipolar.core.servo.step import advance, step
from visual_servo_epipolar.core.servo.telemetry import sample, telemetry
from visual_servo_epipolar.core.settings import Settings
from visual_servo_epipolar.core.stamps import NANOSECONDS, seconds_between
from visual_servo_epipolar.simulation.bases.pioneer import PioneerSettings
from visual_servo_epipolar.simulation.bases.registry import new_base
from visual_servo_epipolar.simulation.view import View

Step = Callable[[ServoState, Observation, ServoSettings], ServoState]

PARTS = ('world', 'perception', 'servo', 'record', 'base')  # of a round of many runs
LARGEST_BLOCK = 16 * 2**20  # bytes, more than any array of a stack takes
SETTLE_FRAMES = 6  # the base may still be braking when the servo says that it has arrived


@dataclass(frozen=True, kw_only=True)
class LoopSettings:
    """One run: where it starts, how it is seeded, how long it may take [s]."""

    start: tuple[float, float, float]
    seed: int = 0
    frame_rate: float = 11.0
    max_duration: float = 300.0
    servo: ServoSettings = field(default_factory=ServoSettings)
    base: Settings = field(default_factory=PioneerSettings)


def period_ns(frame_rate: float) -> int:
    """Return the time between two frames [ns]: whole, so that stamps add up exactly."""
    return round(NANOSECONDS / frame_rate)


def published(pose: Pose) -> Pose:
    """Return ``pose`` as it arrives through a message, where the heading is a quaternion."""
    return Pose(pose.x, pose.y, yaw_from_quaternion(*quaternion_from_yaw(pose.theta)))


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
        return self._braking >= SETTLE_FRAMES or next_ns >= self._limit_ns or self.hopeless

    @property
    def hopeless(self) -> bool:
        """Whether the robot stands and has seen too little for as long as a search may last."""
        if self._seen_ns is None:
            return False
        waited = seconds_between(self._seen_ns, self.samples[-1].stamp_ns)
        return waited > self.settings.servo.holding_timeout

    @property
    def _limit_ns(self) -> float:
        return self.settings.max_duration * NANOSECONDS

    def add(self, sample: Sample, *, reason: str, attempts: int) -> None:
        """Take in one step; what comes after the end is ignored."""
        if self.done:
            return
        self.samples.append(sample)
        self._reason, self._attempts = reason, attempts
        self._braking = self._braking + 1 if sample.phase in ENDED else 0
        few = sample.features < self.settings.servo.min_features
        if not (few and sample.phase is Phase.WAITING) or self._seen_ns is None:
            self._seen_ns = sample.stamp_ns

    def log(self) -> RunLog:
        """Return the record; a run cut off by time has failed."""
        phase, reason = self.samples[-1].phase, self._reason
        if self.hopeless:
            reason = too_few_features(self.samples[-1].features, self.settings.servo)
        elif phase not in ENDED:
            cut = f'not arrived within {self.settings.max_duration:g} s, still {phase.value}'
            reason = f'{cut}: {reason}' if reason else cut
        return RunLog(
            self.settings.start,
            self.settings.seed,
            tuple(self.samples),
            'arrived' if phase is Phase.ARRIVED else 'failed',
            reason,
            self._attempts,
            self.settings.servo.law_expression,
        )


class Loop:
    """One closed loop, step by step: what it sees is perceived outside, alone or beside others."""

    def __init__(self, settings: LoopSettings, view: View, camera: Camera) -> None:
        self.view, self.camera = view, camera
        self.monitor = RunMonitor(settings)
        self._servo = settings.servo
        start = Pose.from_start(*settings.start)
        self._base = new_base(settings.base, start, seed=settings.seed)
        self._state, self._period_ns = ServoState(), period_ns(settings.frame_rate)
        self.pose = published(self._base.pose)

    @property
    def frame(self) -> int:
        """Number of the frame that comes next: 0, 1, ..."""
        return len(self.monitor.samples)

    @property
    def now_ns(self) -> int:
        """Time of the next frame."""
        return self._base.now_ns

    def robot_view(self, observation: Observation) -> RobotView:
        """Return what is to be perceived."""
        return RobotView(observation, self._servo, self._state.frame, self._state.memory)

    def decide(self, perception: Perception) -> None:
        """Take in what was perceived."""
        self._state = advance(self._state, perception, self._servo)

    def decide_by(self, control: Step) -> None:
        """Look, and let ``control`` take it in."""
        features = self.view.observe(self.pose, self.frame)
        observation = observe(features, self.camera, self.now_ns)
        self._state = control(self._state, observation, self._servo)

    def record(self) -> Sample:
        """Note the step that was decided."""
        state = self._state
        taken = sample(self._base.now_ns, self.pose, state.phase, telemetry(state))
        self.monitor.add(taken, reason=state.reason, attempts=state.attempts)
        return taken

    def drive(self) -> None:
        """Obey for one period."""
        self._base.command(self._state.command)
        self._base.advance(self._base.now_ns + self._period_ns)
        self.pose = published(self._base.pose)


def look(loops: Sequence[Loop]) -> list[RobotView]:
    """Return what each loop sees from where its robot is now, alike views and cameras at once."""
    robot_views: list[RobotView | None] = [None] * len(loops)
    groups: dict[tuple[type[View], Camera], list[int]] = {}
    for k, loop in enumerate(loops):
        groups.setdefault((type(loop.view), loop.camera), []).append(k)
    for (kind, camera), indices in groups.items():
        group = [loops[k] for k in indices]
        features = kind.observe_each(
            [loop.view for loop in group],
            [loop.pose for loop in group],
            [loop.frame for loop in group],
        )
        observations = observe_each(features, camera, [loop.now_ns for loop in group])
        for k, observation in zip(indices, observations, strict=True):
            robot_views[k] = loops[k].robot_view(observation)
    return [robot_view for robot_view in robot_views if robot_view is not None]


def run(
    settings: LoopSettings,
    view: View,
    camera: Camera,
    *,
    watch: Callable[[Sample], None] | None = None,
    control: Step = step,
) -> RunLog:
    """
    Drive from the start until the servo ends, and return the record.

    ``watch`` is called after each step; another law may stand in for the servo as ``control``. The
    order of events is that of the nodes in lockstep: ground truth, image, tracks, command, and
    only then does the base move for one period.
    """
    loop = Loop(settings, view, camera)
    while not loop.monitor.done:
        loop.decide_by(control)
        taken = loop.record()
        if watch is not None:
            watch(taken)
        loop.drive()
    return loop.monitor.log()


def run_many(
    runs: Sequence[tuple[LoopSettings, View, Camera]],
    *,
    lap: Callable[[str], None] = lambda part: None,
) -> list[RunLog]:
    """
    Drive many robots side by side, which is faster, and return their records in this order.

    Each record is, bit by bit, what ``run`` returns. ``lap`` is told when a part of each round is
    over, one of PARTS.
    """
    _keep_memory()
    loops = [Loop(*each) for each in runs]
    going = [loop for loop in loops if not loop.monitor.done]
    while going:
        robot_views = look(going)
        lap('world')
        perceptions = perceive_each(robot_views)
        lap('perception')
        for loop, perception in zip(going, perceptions, strict=True):
            loop.decide(perception)
        lap('servo')
        for loop in going:
            loop.record()
        lap('record')
        for loop in going:
            loop.drive()
        lap('base')
        going = [loop for loop in going if not loop.monitor.done]
    return [loop.monitor.log() for loop in loops]


def _keep_memory() -> None:
    """
    Let the allocator keep what it frees: stacked arrays are larger than it keeps at first.

    The GNU one takes the size of the largest block that was freed for the usual size. Otherwise
    each array of a stack comes as new pages, which cost as much as what is computed in it.
    """
    np.empty(LARGEST_BLOCK, np.uint8)
