"""The campaign: which runs there are, and all of them, side by side on this machine."""

from collections.abc import Callable, Sequence
from concurrent.futures import as_completed
import math
from typing import Any, NamedTuple

from visual_servo_epipolar.core.errors import InputError
from visual_servo_epipolar.core.settings import hint
from visual_servo_epipolar.evaluation.faults.catalogue.table import FAULTS
from visual_servo_epipolar.evaluation.faults.judging.record import Verdict
from visual_servo_epipolar.evaluation.faults.processes.table import PROCESSES
from visual_servo_epipolar.sweeping.local import worker_pool
from visual_servo_epipolar.sweeping.provenance import commit

NAMES = (*FAULTS, *PROCESSES)
Result = dict[str, Any]


class Run(NamedTuple):
    """A run: the name of its fault, and the seed that all else is drawn from."""

    fault: str
    seed: int


def plan(names: Sequence[str], runs: int, seed: int) -> list[Run]:
    """
    Return the runs of a campaign: each fault in turn, and again with the next seed.

    Raises InputError for a fault that there is not.
    """
    unknown = sorted(set(names) - set(NAMES))
    if unknown:
        raise InputError(f'no fault {", ".join(unknown)}; {hint(unknown, NAMES)}')
    chosen = list(dict.fromkeys(names)) or list(NAMES)
    return [Run(chosen[k % len(chosen)], seed + k // len(chosen)) for k in range(runs)]


def drive(runs: Sequence[Run], jobs: int, watch: Callable[[Result], None]) -> list[Result]:
    """
    Drive all runs by so many processes; ``watch`` hears of each as it ends.

    Results are in the order of the runs. Raises VisualServoError if a process dies.
    """
    results: dict[Run, Result] = {}
    with worker_pool(jobs, 'give fewer --jobs') as pool:
        futures = {pool.submit(one, run): run for run in runs}
        for future in as_completed(futures):
            results[futures[future]] = future.result()
            watch(future.result())
    return [results[run] for run in runs]


def one(run: Run) -> Result:
    """Drive one run, in this process; if it raises, that is its result."""
    try:
        return _driven(run)
    except Exception as error:  # the other runs of a night shall not be lost
        text = f'{type(error).__name__}: {error}'
        return {**_unjudged(run), 'verdict': Verdict.UNJUDGED.value, 'detail': text}


def _unjudged(run: Run) -> Result:
    """Return the result of a run of which nothing is known."""
    numbers = ('excursion_m', 'blind_s', 'wrong_geometry_s', 'position_error_m', 'duration_s')
    texts = ('struck_in', 'phase', 'reason')
    return {
        'fault': run.fault,
        'seed': run.seed,
        'safe': False,
        'notes': [],
        'charges': [],
        **dict.fromkeys(numbers, math.nan),
        **dict.fromkeys(texts, ''),
    }


def _driven(run: Run) -> Result:
    if run.fault in PROCESSES:
        from visual_servo_epipolar.evaluation.faults.processes import run as processes

        return processes.run(run.fault, PROCESSES[run.fault], run.seed)
    from visual_servo_epipolar.evaluation.faults.run import run as simulated

    return simulated(run.fault, FAULTS[run.fault], run.seed)


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
