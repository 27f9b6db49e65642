"""Calibration errors in closed loop (section VI): arrivals and position errors by f_hat / f."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from itertools import product
from operator import itemgetter
from typing import Any

from visual_servo_epipolar.core.servo.run_log import summarise
from visual_servo_epipolar.evaluation.benchmarks.starts import runs_on_points
from visual_servo_epipolar.evaluation.tables import aligned, cells, Columns, number, numbers
from visual_servo_epipolar.simulation.closed_loop import run as drive
from visual_servo_epipolar.simulation.scenario import Scenario
from visual_servo_epipolar.sweeping.summary import (
    arrived,
    quantile,
    wrong,
    WRONG_HEADING_DEG,
    WRONG_POSITION_M,
)

RATIOS = (0.17, 0.25, 0.5, 0.75, 1.0)  # f_hat / f
SHIFT_PX = 10.0  # of the principal point, to the right and down
MOUNTS = {'above the axle': 0.0, '0.13 m ahead': 0.13}
# What the servo does about the camera matrix.
METHODS: Mapping[str, Mapping[str, Any]] = {
    'found out': {'focal_deviation': 1.0},
    'believed': {},
    'planar_3dof': {'estimator': 'planar_3dof'},
}
CELLS = (  # method, mount, region and number of starts, each with every ratio
    ('found out', 'above the axle', 'front', 64),
    ('found out', 'above the axle', 'beside', 64),
    ('found out', '0.13 m ahead', 'front', 32),
    ('found out', '0.13 m ahead', 'beside', 32),
    ('believed', 'above the axle', 'front', 16),
    ('planar_3dof', 'above the axle', 'front', 16),
)
QUICK_CELLS = tuple((method, 'above the axle', 'front', 2) for method in METHODS)
QUICK_RATIOS = (0.25,)
POSITIONS = ('position_median_m', 'position_p95_m', 'position_max_m')
HEADINGS = ('heading_median_deg', 'heading_p95_deg')
COLUMNS: Columns = {
    'matrix': itemgetter('method'),
    'camera': itemgetter('mount'),
    'region': itemgetter('region'),
    'f_hat/f': lambda row: f'{row["ratio"]:.2f}',
    'arrived': lambda row: f'{row["arrived"]}/{row["starts"]}',
    'wrong': lambda row: str(row['wrong']),
    'position med / p95 / max mm': lambda row: numbers((row[it] for it in POSITIONS), 1, 1e3),
    'heading med / p95 deg': lambda row: numbers((row[it] for it in HEADINGS), 2),
    'time s': lambda row: number(row['duration_s'], 0),
}

Result = dict[str, Any]


def run(*, seed: int, quick: bool, say: Callable[[str], None]) -> dict[str, Any]:
    """Drive with each camera matrix, all from one set of starts, and return rows and runs."""
    rows = []
    places, ratios = (QUICK_CELLS, QUICK_RATIOS) if quick else (CELLS, RATIOS)
    for (name, mount, region, starts), ratio in product(places, ratios):
        say(f'calibration: {name}, camera {mount}, {region}, f_hat/f = {ratio:g} ...')
        runs = runs_on_points(_scenario(name, mount, ratio), region, starts, seed)
        results = [summarise(drive(*each)) for each in runs]
        row = {'method': name, 'mount': mount, 'region': region, 'ratio': ratio}
        rows.append(row | scores(results) | {'runs': results})
    return {'seed': seed, 'shift_px': SHIFT_PX, 'rows': rows}


def _scenario(name: str, mount: str, ratio: float) -> Scenario:
    plain = Scenario().with_servo(METHODS[name])
    camera = replace(
        plain.camera,
        mount_forward=MOUNTS[mount],
        believed_focal_ratio=ratio,
        believed_shift_u=SHIFT_PX,
        believed_shift_v=SHIFT_PX,
    )
    return replace(plain, camera=camera)


def scores(results: Sequence[Result]) -> dict[str, Any]:
    """Return the figures of one row, by ground truth; of no arrivals they are nan."""
    arrivals = [result for result in results if arrived(result)]

    def spread(name: str, share: float) -> float:
        return quantile([abs(result[name]) for result in arrivals], share)

    return {
        'starts': len(results),
        'arrived': len(arrivals),
        'wrong': sum(map(wrong, results)),
        'position_median_m': spread('position_error_m', 0.5),
        'position_p95_m': spread('position_error_m', 0.95),
        'position_max_m': spread('position_error_m', 1.0),
        'heading_median_deg': spread('heading_error_deg', 0.5),
        'heading_p95_deg': spread('heading_error_deg', 0.95),
        'duration_s': spread('duration_s', 0.5),
        'reasons': sorted({result['reason'] for result in results if not arrived(result)}),
    }


def table(document: Mapping[str, Any]) -> str:
    """Return the document as text: one row a camera matrix, region, mount and method."""
    return '\n'.join(
        [
            f'A principal point {document["shift_px"]:g} px off to the right and down, and '
            'f_hat / f times the focal length; point features at 0.2 px',
            f'(wrong: says that it has arrived, and is {WRONG_POSITION_M:g} m or '
            f'{WRONG_HEADING_DEG:g} deg off; errors of the runs that arrived)',
            '',
            *aligned(' | '.join(COLUMNS), cells(COLUMNS, document['rows']), left=3),
        ]
    )
