"""The ablation table: each departure from the paper left out of law full, and each alone."""

from collections.abc import Callable, Mapping
from typing import Any

from visual_servo_epipolar.core.estimate.settings import DEPARTURES
from visual_servo_epipolar.core.laws.registry import LAWS
from visual_servo_epipolar.evaluation.benchmarks.sweeps import (
    ARRIVALS,
    LONGEST_S,
    measure,
    sweep,
    TIME,
    within,
)
from visual_servo_epipolar.evaluation.tables import cells, Columns, markdown, number
from visual_servo_epipolar.simulation.scenario import Scenario

REGIONS = ('front', 'beside', 'anywhere')
STARTS = 100
QUICK_LAWS = ('full', 'full without retreat', 'paper')
COLUMNS: Columns = {
    'law': lambda row: str(row['law']),
    'region': lambda row: str(row['region']),
    **ARRIVALS,
    'd / d_0 p95': lambda row: number(row['max_distance_ratio']['p95'], 2),
    **TIME,
}


def laws() -> dict[str, dict[str, bool]]:
    """Return the departures that each law of a row takes, by its name."""
    full, paper = (
        {name: getattr(LAWS[law], name) for name in DEPARTURES} for law in ('full', 'paper')
    )
    return {
        'full': full,
        **{f'full without {name}': full | {name: False} for name in DEPARTURES},
        'paper': paper,
        **{
            f'paper {"without" if taken else "with"} {name}': paper | {name: not taken}
            for name, taken in paper.items()
        },
    }


def run(*, seed: int, quick: bool, say: Callable[[str], None]) -> dict[str, Any]:
    """Drive every law from the same starts in each region, and return a row for each."""
    starts, names = (1, QUICK_LAWS) if quick else (STARTS, (*laws(),))
    # Law full with every departure left out that the law of a row does not take.
    scenarios = {law: within(Scenario(), LONGEST_S).with_servo(laws()[law]) for law in names}
    rows = [
        (
            {'law': law, 'region': region},
            sweep(region, starts, 'full', scenario, seed + 100 * place),
        )
        for place, region in enumerate(REGIONS[: 1 if quick else None])
        for law, scenario in scenarios.items()
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
