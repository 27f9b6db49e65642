"""One run: its settings, its samples, its end, and the verdict on it."""

from dataclasses import dataclass, field
from itertools import pairwise
import math
from typing import Any

from visual_servo_epipolar.core.geometry.motion import STANDSTILL
from visual_servo_epipolar.core.laws.phase import Phase
from visual_servo_epipolar.core.servo.run_log import (
    MotionLimits,
    RunLog,
    Sample,
    SETTLE_FRAMES,
    summarise,
)
from visual_servo_epipolar.core.servo.settings import ServoSettings
from visual_servo_epipolar.core.servo.supervisor import too_few_features
from visual_servo_epipolar.core.settings import Settings
from visual_servo_epipolar.core.stamps import NANOSECONDS, period_ns, seconds_between
from visual_servo_epipolar.simulation.bases.pioneer import PioneerSettings
from visual_servo_epipolar.simulation.mounts.pan_tilt import HeadSettings
from visual_servo_epipolar.simulation.mounts.sensor import Receipt
from visual_servo_epipolar.simulation.mounts.simulated_rig import SimulatedRig, true_geometry

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
    base: Settings = field(default_factory=PioneerSettings)
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
        delay = float(getattr(self.settings.base, 'command_delay', 0.0))
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
            self.settings.servo.law_expression,
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
    truth = true_geometry(rig, step.pose, frame)
    error = truth.error(step.bearing_current, step.bearing_desired)
    return truth.baseline > LEAST_BASELINE_M and error > WRONG_BEARING
