"""Arrivals, errors, excursions and time on a wrong geometry, over mounts, image sizes, lenses."""

from collections.abc import Callable, Iterable, Mapping, Sequence
from typing import Any

from visual_servo_epipolar.evaluation.benchmarks.mounts import table as text
from visual_servo_epipolar.evaluation.benchmarks.mounts.cells import Cell, on_features
from visual_servo_epipolar.processes import cores
from visual_servo_epipolar.sweeping.local import local_workers
from visual_servo_epipolar.sweeping.plan import Chunk, Plan
from visual_servo_epipolar.sweeping.provenance import commit
from visual_servo_epipolar.sweeping.summary import summary_of

REGION, LAW = 'front', 'full'
STARTS, QUICK_STARTS = 64, 8
LONGEST_S = 180.0  # of a run: with a level camera it takes 35 s
PARTS = 2  # in which the starts of a cell are shared out

Say = Callable[[str], None]
Result = dict[str, Any]


def run(*, seed: int, quick: bool, say: Say) -> dict[str, Any]:
    """Drive each mount, image size and lens on point features from the same starts."""
    starts = QUICK_STARTS if quick else STARTS
    return measured(on_features(quick=quick), 'features', starts, seed=seed, say=say)


def table(document: Mapping[str, Any]) -> str:
    """Return the document as Markdown."""
    return text.table(document)


def measured(
    cells: Iterable[Cell], source: str, starts: int, *, seed: int, say: Say
) -> dict[str, Any]:
    """Return the document of ``cells``: a row each, its runs driven by all cores."""
    cells = list(cells)
    plans = [_plan(cell, source, starts, seed) for cell in cells]
    rows = [
        cell.document() | {k: v for k, v in summary_of(results).items() if k != 'runs'}
        for cell, results in zip(cells, _driven(plans, cells, say), strict=True)
    ]
    return {
        'source': source,
        'region': REGION,
        'starts': starts,
        'seed': seed,
        'longest_s': LONGEST_S,
        'commit': commit(),
        'rows': rows,
    }


def _plan(cell: Cell, source: str, starts: int, seed: int) -> Plan:
    return Plan(
        region=REGION,
        runs=starts,
        source=source,
        laws=(LAW,),
        scenario=cell.scenario(LONGEST_S),
        seed=seed,
    )


def _driven(plans: Sequence[Plan], cells: Sequence[Cell], say: Say) -> list[list[Result]]:
    """Return the results of each plan in the order of its starts."""
    with local_workers(cores()) as workers:
        jobs = [[workers.submit(plan, chunk) for chunk in _chunks(plan)] for plan in plans]
        results = []
        for number, (cell, parts) in enumerate(zip(cells, jobs, strict=True), 1):
            say(f'mounts: {cell.name}, {number} of {len(cells)} ...')
            results.append([result for part in parts for result in part.result()])
    return results


def _chunks(plan: Plan) -> list[Chunk]:
    """Share out the starts of ``plan``: few large chunks on features, one a start on images."""
    size = 1 if plan.source == 'images' else -(-plan.runs // PARTS)
    indices = range(plan.runs)
    return [Chunk(LAW, tuple(indices[first : first + size])) for first in indices[::size]]
