"""One run with one fault, drawn from a seed: its course and its outcome."""

from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Any
import zlib

import cv2
import numpy as np

from visual_servo_epipolar.core.laws.machine import PhaseRow
from visual_servo_epipolar.core.laws.phase import ARMED, Phase
from visual_servo_epipolar.core.laws.registry import phase_named
from visual_servo_epipolar.core.servo.settings import ServoSettings
from visual_servo_epipolar.evaluation.faults.fault import ALWAYS, EVERYWHERE, Fault, StruckRun
from visual_servo_epipolar.evaluation.faults.judge import judge_run, moving, SafetyBounds
from visual_servo_epipolar.evaluation.faults.witness import BASE, SERVO, Witness
from visual_servo_epipolar.evaluation.live.world import small_camera, World, WorldSettings

LOOK_S = 0.1  # how often the phase is looked at
REST_S = 8.0  # that a robot must stand until a run is over: longer than the servo holds
TAIL_S = 2.0  # that it must stand where the servo has ended
PATIENCE_S = 20.0  # for the phase that the fault waits for
LONGEST_S = 180.0  # since the fault struck: past the longest phase


@dataclass(frozen=True, slots=True)
class StrikeTime:
    """When a fault strikes: ``delay_s`` into ``phase``."""

    phase: Phase
    delay_s: float


class FaultDrive:
    """A run of a ``scene``; ``struck_s`` and ``struck_in`` say when the fault struck."""

    def __init__(self, scene: StruckRun, fault: Fault, moment: StrikeTime) -> None:
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
        for name in tuple(self.scene.world.settings.kinds)[::-1]:
            self.scene.world.start(name)
        if self._moment.phase is Phase.WAITING:
            self._strike()
        while not self._done():
            self.scene.world.run_for(LOOK_S)
            self._look()

    def _look(self) -> None:
        now_s, record = self.scene.witness.now_s, self.scene.witness.record
        moves = bool(record.truths) and moving(record.truths[-1].twist)
        if self._may_drive_on or (moves and self.scene.world.works(BASE)):
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


SLACK_S = 0.15  # watchdog, messages and ticks of the base
BESIDE = 0.25  # part of the starts from which the robot turns and backs off first
NO_TIMEOUT = 0.5  # part of the bases that do not stop by themselves
LONGEST_DELAY_S = 3.0  # into a phase
WHOLE_WAY_S = 5.5  # into a phase of another law: one motion lasts 6 to 8 s from these starts
ASIDE = (Phase.ORIENTING, Phase.RETREATING)
COMMON = {*ALWAYS, *ASIDE}


def run(name: str, fault: Fault, seed: int, law: str = ServoSettings.law) -> dict[str, Any]:
    """Drive by a law with a fault, and return what became of it as a JSON object."""
    cv2.setNumThreads(1)
    rng = np.random.default_rng((seed, zlib.crc32(name.encode())))
    beside = bool(rng.random() < BESIDE)
    drawn = _world(seed, rng, beside=beside)
    settings = fault.prepare(replace(drawn, servo=replace(drawn.servo, law=law)), rng)
    moment = strike_time(fault, settings.servo, rng, beside=beside)
    if not fault.base_alone and bool(rng.random() < NO_TIMEOUT):
        settings = replace(settings, base=replace(settings.base, command_timeout=0.0))
    with World(settings) as world:
        drive = FaultDrive(StruckRun(world, Witness(world), rng), fault, moment)
        drive.drive()
        judgement = judge_run(drive.scene.witness.finish(), _bounds(world))
    return judgement.document(
        drive.scene.witness.record,
        fault=name,
        seed=seed,
        law=settings.servo.law,
        start=list(settings.start),
        base_stops_by_itself=settings.base.command_timeout > 0.0,
        moment={'phase': moment.phase.value, 'delay_s': moment.delay_s},
        struck_s=drive.struck_s,
        struck_in=drive.struck_in,
        notes=drive.scene.notes,
        duration_s=drive.time_s,
    )


def _world(seed: int, rng: np.random.Generator, *, beside: bool) -> WorldSettings:
    x, y, heading = rng.uniform(-1.0, 1.0, 3)
    spot = (0.5 * x, -0.2 + 0.3 * y) if beside else (0.3 * x, -1.3 + 0.3 * y)
    start = float(spot[0]), float(spot[1]), float(6.0 * heading)
    return WorldSettings(start=start, seed=seed, camera=small_camera(seed))


def strike_time(
    fault: Fault, servo: ServoSettings, rng: np.random.Generator, *, beside: bool
) -> StrikeTime:
    """Return when a fault strikes a run of ``servo``: in a phase that its law has."""
    phases, rows = fault.phases, servo.machine.rows
    if beside and set(EVERYWHERE) <= set(phases):
        phases = (*phases, *ASIDE)
    if not rows.keys() >= set(EVERYWHERE):  # then it drives in phases of its own
        own = [phase for phase in rows if phase.drives and phase not in COMMON]
        phases = tuple(dict.fromkeys(p for each in phases for p in _instead(each, rows, own)))
    phase = phases[int(rng.integers(len(phases)))]
    longest_s = LONGEST_DELAY_S if phase in COMMON else WHOLE_WAY_S
    return StrikeTime(phase, float(rng.uniform(0.0, longest_s)))


def _instead(phase: Phase, rows: Mapping[Phase, PhaseRow], own: list[Phase]) -> list[Phase]:
    """Return the phases of a law with its ``own`` that stand for one of the paper's steps."""
    if phase in EVERYWHERE:
        return own
    return [phase] if phase in rows else []


def _bounds(world: World) -> SafetyBounds:
    settings, base = world.settings, world.settings.base
    period_s = 1.0 / settings.camera.frame_rate
    given: Mapping[str, float] = world.given.get(SERVO, {})
    return SafetyBounds(
        sight_s=given['stale_timeout'] + given.get('max_latency', 0.0) + period_s + SLACK_S,
        period_s=period_s,
        base_linear=base.max_linear,
        base_angular=base.max_angular,
        base_acceleration=base.acceleration,
        base_deceleration=base.deceleration,
        base_angular_acceleration=base.angular_acceleration,
        delay_s=world.delay_s,
        # What is so much deeper looks alike from so much farther: epipoles take a longer way.
        position_m=SafetyBounds.position_m * settings.depth,
        excursion_m=settings.servo.max_retreat,
    )
