"""One run: how it is set up, what is kept of it, and when it is over."""

from dataclasses import dataclass, field

from visual_servo_epipolar.core.servo.phases.switch import too_few_features
from visual_servo_epipolar.core.servo.phases.table import ENDED, Phase
from visual_servo_epipolar.core.servo.run_log import RunLog, Sample, SETTLE_FRAMES
from visual_servo_epipolar.core.servo.settings import ServoSettings
from visual_servo_epipolar.core.settings import Settings
from visual_servo_epipolar.core.stamps import NANOSECONDS, seconds_between
from visual_servo_epipolar.simulation.bases.pioneer import PioneerSettings


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
