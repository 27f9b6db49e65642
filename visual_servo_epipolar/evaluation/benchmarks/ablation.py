"""The ablation table: each departure from the paper left out of law full, and each alone."""

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import replace
from typing import Any

from visual_servo_epipolar.core.laws.law import DEPARTURES
from visual_servo_epipolar.core.laws.registry import law_named
from visual_servo_epipolar.processes import cores
from visual_servo_epipolar.simulation.scenario import Scenario
from visual_servo_epipolar.sweeping.local import local_workers
from visual_servo_epipolar.sweeping.plan import Plan
from visual_servo_epipolar.sweeping.provenance import commit
from visual_servo_epipolar.sweeping.summary import summary_of

REGIONS = ('front', 'beside', 'anywhere')
STARTS, QUICK_STARTS = 100, 1
LONGEST_S = 120.0  # of a run: law full needs 30 s in front and at most 100 s beside [s]
SEED_STEP = 100  # between the seeds of two regions
NAMES = ('paper', 'corrected', 'full')  # laws of other packages have no row, and need not load
QUICK_LAWS = ('full', 'full-retreat', 'paper')


def laws() -> tuple[str, ...]:
    """Return the expressions of all laws that are compared, each once."""
    return tuple(dict.fromkeys(_laws()))


def _laws() -> Iterator[str]:
    yield 'full'
    yield from (f'full-{name}' for name in DEPARTURES)
    yield 'paper'
    paper = law_named('paper')
    for name in DEPARTURES:
        yield _known(f'paper{"-" if getattr(paper, name) else "+"}{name}')


def _known(expression: str) -> str:
    """Return the name of our law that is the same as ``expression``, or the expression."""
    same = (name for name in NAMES if law_named(name) == law_named(expression))
    return next(same, expression)


def run(*, seed: int, quick: bool, say: Callable[[str], None]) -> dict[str, Any]:
    """Drive every law from the same starts in each region, and return a row for each."""
    starts, names = (QUICK_STARTS, QUICK_LAWS) if quick else (STARTS, laws())
    scenario = Scenario()
    scenario = replace(scenario, run=replace(scenario.run, max_duration=LONGEST_S))
    rows = []
    for number, region in enumerate(REGIONS[:1] if quick else REGIONS):
        plan = Plan(
            region=region,
            runs=starts,
            source='features',
            laws=names,
            scenario=scenario,
            seed=seed + SEED_STEP * number,
        )
        results = _driven(plan, say)
        rows += [
            {'law': law, 'region': region}
            | {k: v for k, v in summary_of(results[law]).items() if k != 'runs'}
            for law in names
        ]
    return {
        'starts': starts,
        'seed': seed,
        'longest_s': LONGEST_S,
        'commit': commit(),
        'departures': dict(DEPARTURES),
        'rows': rows,
    }


def _driven(plan: Plan, say: Callable[[str], None]) -> dict[str, list[dict[str, Any]]]:
    """Return law -> results in the order of the starts, by all cores of this machine."""
    results: dict[str, dict[int, dict[str, Any]]] = {law: {} for law in plan.laws}
    with local_workers(cores()) as workers:
        jobs = [(chunk, workers.submit(plan, chunk)) for chunk in plan.chunks((), workers.count)]
        for number, (chunk, job) in enumerate(jobs, 1):
            say(f'ablation: {plan.region}, {chunk.law}, part {number} of {len(jobs)} ...')
            results[chunk.law].update(zip(chunk.indices, job.result(), strict=True))
    return {law: [done[k] for k in sorted(done)] for law, done in results.items()}


def table(document: Mapping[str, Any]) -> str:
    """Return the document as Markdown: one row a law and region."""
    lines = [
        f'{document["starts"]} starts a region, the same for each law, point features at 0.2 px, '
        f'at most {document["longest_s"]:g} s a run; seed {document["seed"]}, '
        f'commit {document["commit"]}.',
        '',
        '| law | region | arrived | wrong | median / p95 [mm] | heading p95 [deg] '
        '| d / d_0 p95 | time [s] |',
        '|---|---|---|---|---|---|---|---|',
    ]
    return '\n'.join(lines + [_row(row) for row in document['rows']])


def _row(row: Mapping[str, Any]) -> str:
    position = '/'.join(_number(row['position_error_m'][q], 1e3, 1) for q in ('median', 'p95'))
    cells: Sequence[str] = (
        f'`{row["law"]}`',
        row['region'],
        f'{100.0 * row["success_rate"]:.0f} %',
        str(row['arrived_but_wrong']),
        position.replace('/', ' / '),
        _number(row['heading_error_deg']['p95'], 1.0, 2),
        _number(row['max_distance_ratio']['p95'], 1.0, 2),
        _number(row['duration_s']['median'], 1.0, 0),
    )
    return f'| {" | ".join(cells)} |'


def _number(value: float | None, scale: float, digits: int) -> str:
    """Return a figure of the runs that arrived; a dash where none did."""
    if value is None or value != value:
        return '-'
    return f'{scale * value:.{digits}f}'
