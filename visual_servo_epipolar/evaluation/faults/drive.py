"""The course of a run: nodes start, the fault strikes in its phase, the robot comes to rest."""

from dataclasses import dataclass

from visual_servo_epipolar.core.laws.phase import ARMED, Phase
from visual_servo_epipolar.core.laws.registry import phase_named
from visual_servo_epipolar.evaluation.faults.catalogue.fault import Fault, Scene
from visual_servo_epipolar.evaluation.faults.judging.motion import moving
from visual_servo_epipolar.evaluation.faults.judging.witness import BASE, SERVO
from visual_servo_epipolar.evaluation.live.world import NODES

LOOK_S = 0.1  # how often the phase is looked at
REST_S = 8.0  # that a robot must stand until a run is over: longer than the servo holds
TAIL_S = 2.0  # that it must stand where the servo has ended
PATIENCE_S = 20.0  # for the phase that the fault waits for
LONGEST_S = 180.0  # since the fault struck: past the longest phase
STARTING = tuple(NODES)[::-1]


@dataclass(frozen=True, slots=True)
class Moment:
    """When a fault strikes: ``delay_s`` into ``phase``."""

    phase: Phase
    delay_s: float


class Drive:
    """A run of a ``scene``; ``struck_s`` and ``struck_in`` say when the fault struck."""

    def __init__(self, scene: Scene, fault: Fault, moment: Moment) -> None:
        self.scene, self._fault, self._moment = scene, fault, moment
        self.struck_s: float | None = None
        self.struck_in = ''
        self._begin_s = scene.witness.now_s
        self._reached_s: float | None = None  # when the phase of the moment was seen
        self._moved_s = self._begin_s  # when the robot moved last, or something was to happen

    @property
    def time_s(self) -> float:
        """Time since the nodes were started."""
        return self.scene.witness.now_s - self._begin_s

    def drive(self) -> None:
        """Run until the robot has stood for long enough, or for as long as a run may take."""
        for name in STARTING:
            self.scene.world.start(name)
        if self._moment.phase is Phase.WAITING:
            self._strike()
        while not self._done():
            self.scene.world.run_for(LOOK_S)
            self._look()

    def _look(self) -> None:
        now_s, record = self.scene.witness.now_s, self.scene.witness.record
        works = self.scene.world.works(BASE)
        if works and record.truths and moving(record.truths[-1].twist):
            self._moved_s = now_s
        if self._reached_s is None and record.phase == self._moment.phase.value:
            self._reached_s = now_s
        reached = self._reached_s is not None and now_s >= self._reached_s + self._moment.delay_s
        never = self._phase.ended or self.time_s > PATIENCE_S
        if self.struck_s is None and (reached or (never and self._reached_s is None)):
            self._strike()

    def _strike(self) -> None:
        self.struck_s, self.struck_in = self.time_s, self.scene.witness.record.phase
        self.scene.witness.struck_ns = self.scene.world.wire.now_ns
        self._fault.strike(self.scene)
        self._moved_s = self.scene.witness.now_s

    @property
    def _phase(self) -> Phase:
        """Phase that the servo published last."""
        word = self.scene.witness.record.phase
        return Phase.WAITING if word == ARMED else phase_named(word)

    @property
    def _may_drive_on(self) -> bool:
        """Whether a servo works that drives: it may stand for as long as a phase lasts."""
        return self._phase.drives and self.scene.world.works(SERVO)

    def _done(self) -> bool:
        if self.time_s >= (self.struck_s or 0.0) + LONGEST_S:
            return True
        if self.struck_s is None or self._may_drive_on:
            return False
        quiet_s = self.scene.witness.now_s - max(self._moved_s, self.scene.busy_s)
        calm = self._phase.ended and self.time_s > self.struck_s + REST_S
        return quiet_s >= (TAIL_S if calm else REST_S)
