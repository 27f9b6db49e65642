"""
Arrivals, errors, excursions and time on a wrong geometry, over mounts, image sizes and lenses.

On point features, or (``mounts_images``) on rendered images through the real tracker, which takes
half an hour.
"""

from collections.abc import Callable, Iterable, Mapping
from functools import partial
from types import SimpleNamespace
from typing import Any

from visual_servo_epipolar.evaluation.benchmarks.arrivals.mount_cells import (
    MountCell,
    on_features,
    on_images,
)
from visual_servo_epipolar.evaluation.benchmarks.arrivals.starts import (
    ARRIVALS,
    summaries_of,
    TIME,
)
from visual_servo_epipolar.evaluation.tables import cells, Columns, markdown, number, numbers
from visual_servo_epipolar.sweeping.plan import SweepPlan
from visual_servo_epipolar.sweeping.provenance import commit

REGION, LAW = 'front', 'full'
STARTS = {'features': 64, 'images': 10}
QUICK_STARTS = {'features': 8, 'images': 1}
LONGEST_S = 180.0  # of a run: with a level camera it takes 35 s
SOURCES = {'features': 'point features at 0.2 px', 'images': 'rendered images'}
GROUPS = {
    'attitude': 'tilt (down positive) and roll (clockwise)',
    'yaw': 'yaw (left positive) and place, ahead and left of the axle',
    'worse': 'worse, with a right wheel 1 % larger',
    'size': 'image size [px], field of view 79.5 deg',
    'lens': 'lens',
}
COLUMNS: Columns = {
    **ARRIVALS,
    'excursion, p95 / max': lambda row: numbers((row['excursion'][q] for q in ('p95', 'max')), 2),
    'wrong geometry, max [s]': lambda row: number(row['wrong_geometry_s']['max'], 1),
    **TIME,
}


def run(
    source: str = 'features', *, seed: int, quick: bool, say: Callable[[str], None]
) -> dict[str, Any]:
    """Drive each mount, image size and lens from the same starts."""
    cells = {'features': on_features, 'images': on_images}[source](quick=quick)
    starts = (QUICK_STARTS if quick else STARTS)[source]
    return measure_cells(cells, source, starts, seed=seed, say=say)


def measure_cells(
    cells: Iterable[MountCell], source: str, starts: int, *, seed: int, say: Callable[[str], None]
) -> dict[str, Any]:
    """Return the document of ``cells``: a row each."""
    cells = list(cells)
    plans = [
        SweepPlan(
            region=REGION,
            runs=starts,
            source=source,
            laws=(LAW,),
            scenario=cell.scenario(LONGEST_S),
            seed=seed,
        )
        for cell in cells
    ]
    summaries = summaries_of(plans, lambda text: say(f'mounts: {text}'))
    return {
        'source': source,
        'region': REGION,
        'starts': starts,
        'seed': seed,
        'longest_s': LONGEST_S,
        'commit': commit(),
        'rows': [cell.document() | it for cell, it in zip(cells, summaries, strict=True)],
    }


def table(document: Mapping[str, Any]) -> str:
    """Return the document as Markdown: a line that says what was done, then a table a group."""
    lines = [
        f'{document["starts"]} starts in `{document["region"]}`, the same for each camera, '
        f'{SOURCES[document["source"]]}, at most {document["longest_s"]:g} s a run; the servo is '
        f'told nothing of the mount. Seed {document["seed"]}, commit {document["commit"]}.',
        'Errors of the runs that arrived; excursion (largest distance over the first) and the '
        'time driven on bearings more than 10 deg wrong of all runs.',
    ]
    for group, title in GROUPS.items():
        rows = [row for row in document['rows'] if row['group'] == group]
        if rows:
            columns = {title: lambda row: str(row['name']), **COLUMNS}
            lines += ['', *markdown(' | '.join(columns), cells(columns, rows))]
    return '\n'.join(lines)


ON_IMAGES = SimpleNamespace(run=partial(run, 'images'), table=table)
