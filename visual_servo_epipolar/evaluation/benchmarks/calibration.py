"""Calibration errors in closed loop (section VI): arrivals and position errors by f_hat / f."""

from collections.abc import Callable, Mapping
from dataclasses import replace
from itertools import product
from operator import itemgetter
from typing import Any

from visual_servo_epipolar.evaluation.benchmarks.sweeps import ARRIVALS, measure, sweep, TIME
from visual_servo_epipolar.evaluation.tables import aligned, cells, Columns
from visual_servo_epipolar.simulation.scenario import Scenario

RATIOS = (0.17, 0.25, 0.5, 0.75, 1.0)  # f_hat / f
LAW = Scenario().servo.law
SHIFT_PX = 10.0  # of the principal point, to the right and down
MOUNTS = {'above the axle': 0.0, '0.13 m ahead': 0.13}
# What the servo does about the camera matrix.
METHODS: Mapping[str, Mapping[str, Any]] = {
    'found out': {'focal_deviation': 1.0},
    'believed': {},
}
CELLS = (  # method, mount, region and number of starts, each with every ratio
    ('found out', 'above the axle', 'front', 64),
    ('found out', 'above the axle', 'beside', 64),
    ('found out', '0.13 m ahead', 'front', 32),
    ('found out', '0.13 m ahead', 'beside', 32),
    ('believed', 'above the axle', 'front', 16),
)
COLUMNS: Columns = {
    'matrix': itemgetter('method'),
    'camera': itemgetter('mount'),
    'region': itemgetter('region'),
    'f_hat/f': lambda row: f'{row["ratio"]:.2f}',
    'of': lambda row: str(len(row['runs'])),
    **ARRIVALS,
    **TIME,
}


def run(*, seed: int, quick: bool, say: Callable[[str], None]) -> dict[str, Any]:
    """Drive with each camera matrix, all from one set of starts, and return rows with runs."""
    few = [(method, 'above the axle', 'front', 2) for method in METHODS]
    places, ratios = (few, RATIOS[1:2]) if quick else ([*CELLS], RATIOS)
    rows = [
        (
            {'method': method, 'mount': mount, 'region': region, 'ratio': ratio, 'starts': starts},
            sweep(region, starts, LAW, _scenario(method, mount, ratio), seed),
        )
        for (method, mount, region, starts), ratio in product(places, ratios)
    ]
    return measure(rows, say, with_runs=True, seed=seed, shift_px=SHIFT_PX)


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


def table(document: Mapping[str, Any]) -> str:
    """Return the document as text: one row a camera matrix, region, mount and method."""
    words = (
        f'A principal point {document["shift_px"]:g} px off to the right and down, and '
        'f_hat / f times the focal length; point features at 0.2 px; errors of arrivals'
    )
    rows = cells(COLUMNS, document['rows'])
    return '\n'.join([words, '', *aligned(' | '.join(COLUMNS), rows, left=3)])
