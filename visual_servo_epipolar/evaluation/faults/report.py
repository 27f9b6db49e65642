"""Report of a campaign: the table of faults and verdicts, and what was unsafe."""

from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from itertools import groupby
from typing import Any

from visual_servo_epipolar.evaluation.faults.campaign import NAMES
from visual_servo_epipolar.evaluation.faults.catalogue.table import FAULTS
from visual_servo_epipolar.evaluation.faults.judging.record import Verdict
from visual_servo_epipolar.evaluation.faults.processes.table import PROCESSES

LONGEST_NOTE = 120  # [characters]
HEAD = (
    '| fault | what | arrived | at rest | unsafe | excursion [m] | without sight [s] '
    '| wrong geometry [s] |',
    '|---|---|---|---|---|---|---|---|',
)


def table(document: Mapping[str, Any]) -> str:
    """Return a campaign as Markdown: one row a fault, then each unsafe run."""
    results = sorted(document['runs'], key=lambda it: NAMES.index(it['fault']))
    total = len(results)
    lines = [
        f'{total} runs, seeds from {document["seed"]}, commit {document["commit"]}: '
        f'{document["safe"]} safe, {document["unsafe"]} unsafe.',
        '',
        *HEAD,
    ]
    lines += [_row(name, list(runs)) for name, runs in groupby(results, lambda it: it['fault'])]
    return '\n'.join([*lines, *_offences(results)])


def _row(name: str, runs: Sequence[Mapping[str, Any]]) -> str:
    counts = Counter(run['verdict'] for run in runs)
    unsafe = ', '.join(
        f'{counts[it.value]} {it.value}'
        for it in Verdict
        if counts[it.value] and it not in (Verdict.ARRIVED, Verdict.AT_REST)
    )
    what = FAULTS[name].what if name in FAULTS else PROCESSES[name].what
    worst = (
        max(run[key] for run in runs) for key in ('excursion_m', 'blind_s', 'wrong_geometry_s')
    )
    cells = (
        f'`{name}`',
        what,
        str(counts[Verdict.ARRIVED.value]),
        str(counts[Verdict.AT_REST.value]),
        unsafe or '0',
        *(f'{value:.1f}' for value in worst),
    )
    return f'| {" | ".join(cells)} |'


def _offences(results: Sequence[Mapping[str, Any]]) -> Iterator[str]:
    unsafe = [run for run in results if not run['safe']]
    if unsafe:
        yield from ('', 'Unsafe:', '')
    yield from (f'- {offence(run)}' for run in unsafe)


def offence(run: Mapping[str, Any]) -> str:
    """Return what an unsafe run did, and how to repeat it."""
    notes = f', {"; ".join(run["notes"])[:LONGEST_NOTE]}' if run['notes'] else ''
    return (
        f'`--only {run["fault"]} --seed {run["seed"]}`: {run["verdict"]}: {run["detail"]} '
        f'({run["struck_in"] or "at the start"}{notes})'
    )
