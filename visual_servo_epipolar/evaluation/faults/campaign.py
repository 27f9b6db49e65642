"""The campaign: runs with one fault each, side by side on this machine; document and table."""

from collections import Counter
from collections.abc import Callable, Mapping, Sequence
from concurrent.futures import as_completed
from dataclasses import replace
from itertools import groupby
import math
from typing import Any, NamedTuple
import zlib

import cv2
import numpy as np

from visual_servo_epipolar.core.errors import InputError
from visual_servo_epipolar.core.laws.phase import ARMED, Phase
from visual_servo_epipolar.core.laws.registry import phase_named
from visual_servo_epipolar.core.settings import hint
from visual_servo_epipolar.evaluation.faults.fault import (
    BASE,
    Fault,
    RunStage,
    SERVO,
    StruckRun,
    Witness,
)
from visual_servo_epipolar.evaluation.faults.judge import (
    judge_run,
    Judgement,
    moving,
    Record,
    RunVerdict,
    SAFE,
    SafetyBounds,
)
from visual_servo_epipolar.evaluation.faults.table import FAULTS
from visual_servo_epipolar.evaluation.faults.world import (
    NODES,
    open_world,
    small_camera,
    World,
    WorldSettings,
)
from visual_servo_epipolar.evaluation.tables import markdown
from visual_servo_epipolar.nodes.startup.settings import DriverNodeSettings
from visual_servo_epipolar.sweeping.provenance import commit
from visual_servo_epipolar.sweeping.workers import worker_pool

Result = dict[str, Any]


REST_S = 8.0  # that a robot must stand until a run is over: longer than the servo holds
LONGEST_S = 180.0  # since the fault struck: past the longest phase


WHOLE_WAY_S = 10.0  # from the first motion on, most of the way from these starts
AFTERWARDS_S = 3.0  # likewise from the end of a run on


class FaultDrive:
    """
    A run of a ``scene`` whose fault strikes ``delay_s`` into a ``stage``.

    ``struck_s`` and ``struck_in`` say when, and in which phase, it did.
    """

    def __init__(self, scene: StruckRun, fault: Fault, stage: RunStage, delay_s: float) -> None:
        self.scene, self._fault, self._stage, self._delay_s = scene, fault, stage, delay_s
        self.struck_s: float | None = None
        self.struck_in = ''
        self._begin_s = scene.witness.now_s
        self._reached_s = math.inf  # when the stage was
        self._moved_s = self._begin_s  # when the robot moved last, or something was to happen

    @property
    def time_s(self) -> float:
        """Time since the nodes were started."""
        return self.scene.witness.now_s - self._begin_s

    def drive(self) -> None:
        """Run until the robot has stood for long enough, or for as long as a run may take."""
        for name in tuple(NODES)[::-1]:
            self.scene.world.start(name)
        if self._stage is RunStage.BEGIN:
            self._strike()
        while not self._done():
            self.scene.world.run_for(0.1)
            self._look()

    def _look(self) -> None:
        now_s, record = self.scene.witness.now_s, self.scene.witness.record
        moves = bool(record.truths) and moving(record.truths[-1].twist)
        if self._may_drive_on or (moves and self.scene.world.works(BASE)):
            self._moved_s = now_s
        ended = self._phase.ended
        if self._phase.drives if self._stage is RunStage.DRIVING else ended:
            self._reached_s = min(self._reached_s, now_s)
        never = self.time_s > 20.0 and self._reached_s == math.inf
        over = ended and self._stage is RunStage.DRIVING
        if self.struck_s is None and (now_s >= self._reached_s + self._delay_s or never or over):
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
        return quiet_s >= (2.0 if calm else REST_S)


def drive_one(name: str, fault: Fault, seed: int) -> dict[str, Any]:
    """Drive with a fault, and return what became of it as a JSON object."""
    cv2.setNumThreads(1)
    rng = np.random.default_rng((seed, zlib.crc32(name.encode())))
    beside = bool(rng.random() < 0.25)  # from there it turns and backs off first
    settings = _world(seed, rng, beside=beside)
    stage = fault.stages[int(rng.integers(len(fault.stages)))]
    delay_s = rng.uniform(0.0, WHOLE_WAY_S if stage is RunStage.DRIVING else AFTERWARDS_S)
    if not fault.base_alone and bool(rng.random() < 0.5):
        settings = replace(settings, base=replace(settings.base, command_timeout=0.0))
    with open_world(settings) as world:
        drive = FaultDrive(StruckRun(world, Witness(world), rng), fault, stage, float(delay_s))
        drive.drive()
        judgement = judge_run(drive.scene.witness.finish(), _bounds(world))
    return judgement.document(
        drive.scene.witness.record,
        fault=name,
        seed=seed,
        start=list(settings.start),
        base_stops_by_itself=settings.base.command_timeout > 0.0,
        moment={'stage': stage.value, 'delay_s': float(delay_s)},
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


def _bounds(world: World) -> SafetyBounds:
    settings, period_s = world.settings, 1.0 / world.settings.camera.frame_rate
    sight_s = settings.servo.stale_timeout + DriverNodeSettings.max_latency
    return SafetyBounds(
        sight_s=sight_s + period_s + 0.15,  # watchdog, messages, ticks
        period_s=period_s,
        base=replace(settings.base, command_delay=world.delay_s),
        excursion_m=settings.servo.max_retreat,
    )


class FaultRun(NamedTuple):
    """A run: the name of its fault, and the seed that all else is drawn from."""

    fault: str
    seed: int


def plan(names: Sequence[str], runs: int, seed: int) -> list[FaultRun]:
    """
    Return the runs of a campaign: each fault in turn, and again with the next seed.

    Raises InputError for a fault that there is not.
    """
    unknown = sorted(set(names) - set(FAULTS))
    if unknown:
        raise InputError(f'unknown fault {", ".join(unknown)}; {hint(unknown, [*FAULTS])}')
    chosen = list(dict.fromkeys(names)) or list(FAULTS)
    return [FaultRun(chosen[k % len(chosen)], seed + k // len(chosen)) for k in range(runs)]


def drive(runs: Sequence[FaultRun], jobs: int, watch: Callable[[Result], None]) -> list[Result]:
    """
    Drive all runs by so many processes; ``watch`` hears of each as it ends.

    Results are in the order of the runs. Raises VisualServoError if a process dies.
    """
    with worker_pool(jobs, 'give fewer --jobs') as pool:
        futures = [pool.submit(one, run) for run in runs]
        for future in as_completed(futures):
            watch(future.result())
    return [future.result() for future in futures]


def one(run: FaultRun) -> Result:
    """Drive one run, in this process; if it raises, that is its result."""
    try:
        return drive_one(run.fault, FAULTS[run.fault], run.seed)
    except Exception as error:  # the other runs of a night shall not be lost
        nothing = Judgement(RunVerdict.UNJUDGED, f'{type(error).__name__}: {error}')
        facts = {'fault': run.fault, 'seed': run.seed, 'notes': [], 'struck_in': ''}
        return nothing.document(Record(phase=''), **facts, duration_s=0.0)


def document(results: Sequence[Result], seed: int) -> dict[str, Any]:
    """Return a campaign as a JSON object."""
    unsafe = [result for result in results if not result['safe']]
    return {
        'runs': list(results),
        'seed': seed,
        'commit': commit(),
        'safe': len(results) - len(unsafe),
        'unsafe': len(unsafe),
    }


def table(document: Mapping[str, Any]) -> str:
    """Return a campaign as Markdown: one row a fault, then each unsafe run."""
    names = [*FAULTS]
    results = sorted(document['runs'], key=lambda it: names.index(it['fault']))
    rows = (_row(name, list(runs)) for name, runs in groupby(results, lambda it: it['fault']))
    words = (
        f'{len(results)} runs, seeds from {document["seed"]}, commit {document["commit"]}: '
        f'{document["safe"]} safe, {document["unsafe"]} unsafe.'
    )
    offences = [f'- {offence(run)}' for run in results if not run['safe']]
    head = 'fault | what | arrived | at rest | unsafe | excursion [m] | without sight [s]'
    lines = [words, '', *markdown(head, rows)]
    return '\n'.join([*lines, '', 'Unsafe:', '', *offences] if offences else lines)


def _row(name: str, runs: Sequence[Mapping[str, Any]]) -> list[str]:
    counts = Counter(run['verdict'] for run in runs)
    unsafe = [it.value for it in RunVerdict if counts[it.value] and it not in SAFE]
    worst = (max(run[key] for run in runs) for key in ('excursion_m', 'blind_s'))
    return [
        f'`{name}`',
        FAULTS[name].what,
        *(str(counts[it.value]) for it in SAFE),
        ', '.join(f'{counts[it]} {it}' for it in unsafe) or '0',
        *(f'{value:.1f}' for value in worst),
    ]


def offence(run: Mapping[str, Any]) -> str:
    """Return what an unsafe run did, and how to repeat it."""
    notes = f', {"; ".join(run["notes"])[:120]}' if run['notes'] else ''
    return (
        f'`--only {run["fault"]} --seed {run["seed"]}`: {run["verdict"]}: {run["detail"]} '
        f'({run["struck_in"] or "at the start"}{notes})'
    )
