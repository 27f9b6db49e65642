"""Benchmarks whose rows are sweeps on point features: shared starts, workers and columns."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from typing import Any

from visual_servo_epipolar.evaluation.tables import Columns, number, numbers
from visual_servo_epipolar.processes import cores
from visual_servo_epipolar.simulation.scenario import Scenario
from visual_servo_epipolar.sweeping.plan import SweepPlan
from visual_servo_epipolar.sweeping.provenance import commit
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

LONGEST_S = 120.0  # of a run: law full needs 30 s in front and at most 100 s beside [s]

Key = Mapping[str, Any]


def sweep(region: str, runs: int, law: str, scenario: Scenario, seed: int) -> SweepPlan:
    """Return the plan of one row."""
    return SweepPlan(
        region=region, runs=runs, source='features', laws=(law,), scenario=scenario, seed=seed
    )


def within(scenario: Scenario, longest_s: float) -> Scenario:
    """Return a scenario whose runs take ``longest_s`` [s] at most."""
    return replace(scenario, run=replace(scenario.run, max_duration=longest_s))


def measure(
    rows: Sequence[tuple[Key, SweepPlan]],
    say: Callable[[str], None],
    *,
    with_runs: bool = False,
    **facts: Any,
) -> dict[str, Any]:
    """Return the document: ``facts``, commit, and each key with the summary of its sweep."""
    results: list[dict[int, dict[str, Any]]] = [{} for _ in rows]
    with local_workers(cores()) as workers:
        jobs = [
            (number, chunk, workers.submit(plan, chunk))
            for number, (_, plan) in enumerate(rows)
            for chunk in plan.chunks((), 1)  # plans share the workers: few large chunks of each
        ]
        for done, (number, chunk, job) in enumerate(jobs, 1):
            say(f'{rows[number][1].region}, {chunk.law}: part {done} of {len(jobs)} ...')
            results[number].update(zip(chunk.indices, job.result(), strict=True))
    summaries = [summary_of([runs[index] for index in sorted(runs)]) for runs in results]
    if not with_runs:
        summaries = [{k: v for k, v in it.items() if k != 'runs'} for it in summaries]
    document = [{**key, **it} for (key, _), it in zip(rows, summaries, strict=True)]
    return {**facts, 'commit': commit(), 'rows': document}
