"""Closed loops from the same starts: plans that all cores drive, and columns of their tables."""

from collections.abc import Callable, Sequence
from typing import Any

from visual_servo_epipolar.evaluation.tables import Columns, number, numbers
from visual_servo_epipolar.processes import cores
from visual_servo_epipolar.sweeping.plan import SweepPlan
from visual_servo_epipolar.sweeping.summary import summary_of
from visual_servo_epipolar.sweeping.workers import local_workers

# Columns of a table of summaries, which go well with others.
ARRIVALS: Columns = {
    'arrived': lambda row: f'{100.0 * row["success_rate"]:.0f} %',
    'wrong': lambda row: str(row['arrived_but_wrong']),
    'position, median / p95 [mm]': lambda row: numbers(
        (row['position_error_m'][q] for q in ('median', 'p95')), 1, 1e3
    ),
    'heading p95 [deg]': lambda row: number(row['heading_error_deg']['p95'], 2),
}
TIME: Columns = {'time [s]': lambda row: number(row['duration_s']['median'], 0)}


def summaries_of(
    plans: Sequence[SweepPlan], say: Callable[[str], None], *, with_runs: bool = False
) -> list[dict[str, Any]]:
    """Return the summary of each law of each plan, ``with_runs`` or without them."""
    results: dict[tuple[int, str], dict[int, dict[str, Any]]] = {
        (number, law): {} for number, plan in enumerate(plans) for law in plan.laws
    }
    with local_workers(cores()) as workers:
        jobs = [
            (number, chunk, workers.submit(plan, chunk))
            for number, plan in enumerate(plans)
            for chunk in plan.chunks((), 1)  # plans share the workers: few large chunks of each
        ]
        for done, (number, chunk, job) in enumerate(jobs, 1):
            say(f'{plans[number].region}, {chunk.law}: part {done} of {len(jobs)} ...')
            results[number, chunk.law].update(zip(chunk.indices, job.result(), strict=True))
    summaries = [summary_of([runs[index] for index in sorted(runs)]) for runs in results.values()]
    return [{k: it[k] for k in it if with_runs or k != 'runs'} for it in summaries]
