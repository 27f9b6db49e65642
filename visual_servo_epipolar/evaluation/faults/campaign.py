"""The campaign: all faults, its runs side by side on this machine, its document and table."""

from collections import Counter
from collections.abc import Callable, Mapping, Sequence
from concurrent.futures import as_completed
from itertools import groupby
import math
from typing import Any, NamedTuple

from visual_servo_epipolar.core.errors import InputError
from visual_servo_epipolar.core.servo.settings import ServoSettings
from visual_servo_epipolar.core.settings import hint
from visual_servo_epipolar.evaluation.faults import processes, robot, sensing
from visual_servo_epipolar.evaluation.faults import run as simulated
from visual_servo_epipolar.evaluation.faults.fault import Fault, Faults
from visual_servo_epipolar.evaluation.faults.judge import RunVerdict, SAFE
from visual_servo_epipolar.evaluation.faults.processes import PROCESSES
from visual_servo_epipolar.evaluation.tables import markdown
from visual_servo_epipolar.sweeping.provenance import commit
from visual_servo_epipolar.sweeping.workers import worker_pool

FAULTS: Faults = {
    'none': Fault('nothing is wrong'),
    **sensing.IMAGE_STREAM,
    **sensing.SHOWN,
    **sensing.SCENES,
    **sensing.TRACK_STREAM,
    **sensing.CALIBRATION,
    **robot.CLOCKS,
    **robot.ORDERS,
    **robot.BASE,
    **robot.NODE_ENDS,
    **robot.ENCODERS,
    **robot.ROUTES,
}
WORDS = {name: fault.what for name, fault in FAULTS.items()}
WORDS |= {name: fault.what for name, fault in PROCESSES.items()}
NAMES = tuple(WORDS)
Result = dict[str, Any]


class FaultRun(NamedTuple):
    """A run: the name of its fault, the seed that all else is drawn from, and the law."""

    fault: str
    seed: int
    law: str = ServoSettings.law


def plan(names: Sequence[str], runs: int, seed: int, law: str = '') -> list[FaultRun]:
    """
    Return the runs of a campaign: each fault in turn, and again with the next seed.

    Without a ``law`` it is the default. Raises InputError for a fault or law that there is not.
    """
    law = law or ServoSettings.law
    try:
        ServoSettings(law=law)
    except ValueError as error:
        raise InputError(str(error)) from None
    unknown = sorted(set(names) - set(NAMES))
    if unknown:
        raise InputError(f'unknown fault {", ".join(unknown)}; {hint(unknown, NAMES)}')
    chosen = list(dict.fromkeys(names)) or list(NAMES)
    return [FaultRun(chosen[k % len(chosen)], seed + k // len(chosen), law) for k in range(runs)]


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
        return _driven(run)
    except Exception as error:  # the other runs of a night shall not be lost
        numbers = ('excursion_m', 'blind_s', 'wrong_geometry_s', 'position_error_m', 'duration_s')
        return {
            'fault': run.fault,
            'seed': run.seed,
            'safe': False,
            'notes': [],
            'charges': [],
            **dict.fromkeys(numbers, math.nan),
            **dict.fromkeys(('struck_in', 'phase', 'reason'), ''),
            'verdict': RunVerdict.UNJUDGED.value,
            'detail': f'{type(error).__name__}: {error}',
        }


def _driven(run: FaultRun) -> Result:
    if run.fault in PROCESSES:
        return processes.run(run.fault, PROCESSES[run.fault], run.seed)
    return simulated.run(run.fault, FAULTS[run.fault], run.seed, run.law)


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


LONGEST_NOTE = 120  # [characters]
HEAD = (
    'fault | what | arrived | at rest | unsafe | excursion [m] | without sight [s] '
    '| wrong geometry [s]'
)


def table(document: Mapping[str, Any]) -> str:
    """Return a campaign as Markdown: one row a fault, then each unsafe run."""
    results = sorted(document['runs'], key=lambda it: NAMES.index(it['fault']))
    rows = (_row(name, list(runs)) for name, runs in groupby(results, lambda it: it['fault']))
    words = (
        f'{len(results)} runs, seeds from {document["seed"]}, commit {document["commit"]}: '
        f'{document["safe"]} safe, {document["unsafe"]} unsafe.'
    )
    offences = [f'- {offence(run)}' for run in results if not run['safe']]
    lines = [words, '', *markdown(HEAD, rows)]
    return '\n'.join([*lines, '', 'Unsafe:', '', *offences] if offences else lines)


def _row(name: str, runs: Sequence[Mapping[str, Any]]) -> list[str]:
    counts = Counter(run['verdict'] for run in runs)
    unsafe = [it.value for it in RunVerdict if counts[it.value] and it not in SAFE]
    worst = (
        max(run[key] for run in runs) for key in ('excursion_m', 'blind_s', 'wrong_geometry_s')
    )
    return [
        f'`{name}`',
        WORDS[name],
        *(str(counts[it.value]) for it in SAFE),
        ', '.join(f'{counts[it]} {it}' for it in unsafe) or '0',
        *(f'{value:.1f}' for value in worst),
    ]


def offence(run: Mapping[str, Any]) -> str:
    """Return what an unsafe run did, and how to repeat it."""
    notes = f', {"; ".join(run["notes"])[:LONGEST_NOTE]}' if run['notes'] else ''
    return (
        f'`--only {run["fault"]} --seed {run["seed"]}`: {run["verdict"]}: {run["detail"]} '
        f'({run["struck_in"] or "at the start"}{notes})'
    )
