"""The ablation table: each departure from the paper left out of law full, and each alone."""

from collections.abc import Callable, Iterator, Mapping
from typing import Any

from visual_servo_epipolar.core.estimate.settings import DEPARTURES
from visual_servo_epipolar.core.laws.registry import law_named
from visual_servo_epipolar.evaluation.benchmarks.sweeps import (
    ARRIVALS,
    measure,
    sweep,
    TIME,
    within,
)
from visual_servo_epipolar.evaluation.tables import cells, Columns, markdown, number
from visual_servo_epipolar.simulation.scenario import Scenario

REGIONS = ('front', 'beside', 'anywhere')
STARTS, QUICK_STARTS = 100, 1
LONGEST_S = 120.0  # of a run: law full needs 30 s in front and at most 100 s beside [s]
NAMES = ('paper', 'corrected', 'full')  # laws of other packages have no row, and need not load
QUICK_LAWS = ('full', 'full-retreat', 'paper')
COLUMNS: Columns = {
    'law': lambda row: f'`{row["law"]}`',
    'region': lambda row: str(row['region']),
    **ARRIVALS,
    'd / d_0 p95': lambda row: number(row['max_distance_ratio']['p95'], 2),
    **TIME,
}


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
    scenario = within(Scenario(), LONGEST_S)
    rows = [
        ({'law': law, 'region': region}, sweep(region, starts, law, scenario, seed + 100 * place))
        for place, region in enumerate(REGIONS[: 1 if quick else None])
        for law in names
    ]
    facts: dict[str, Any] = {'starts': starts, 'seed': seed, 'longest_s': LONGEST_S}
    return measure(rows, say, departures=dict(DEPARTURES), **facts)


def table(document: Mapping[str, Any]) -> str:
    """Return the document as Markdown: one row a law and region."""
    words = (
        f'{document["starts"]} starts a region, the same for each law, point features at 0.2 px, '
        f'at most {document["longest_s"]:g} s a run; seed {document["seed"]}, '
        f'commit {document["commit"]}.'
    )
    return '\n'.join([words, '', *markdown(' | '.join(COLUMNS), cells(COLUMNS, document['rows']))])
