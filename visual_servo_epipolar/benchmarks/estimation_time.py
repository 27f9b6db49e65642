"""Time of the estimators, beside the peers on the same matches, by turns."""

from collections.abc import Callable, Mapping
from time import perf_counter
from typing import Any

import numpy as np

from visual_servo_epipolar.benchmarks.estimation_peers import (
    Knowledge,
    NEAR,
    ours,
    peers,
    Solver,
)
from visual_servo_epipolar.benchmarks.estimation_scenes import Cell, draw_pairs
from visual_servo_epipolar.core.estimators.lmeds_8pt import lmeds_8pt
from visual_servo_epipolar.core.estimators.planar_2dof import planar_2dof
from visual_servo_epipolar.core.estimators.planar_3dof import planar_3dof
from visual_servo_epipolar.core.estimators.soft_planar import soft_planar

REFERENCE = 'opencv LMedS F'
PAIRS = 40
CELLS: Mapping[str, Cell] = {
    'ideal, 3 m': Cell(baseline=3.0),
    'realistic, 3 m': Cell(baseline=3.0, tilt=1.0, roll=0.5, jitter=0.1, outliers=0.2),
}


def timed() -> Mapping[str, Solver]:
    """Return what is timed; `warm` knows the bearings of the frame before."""
    return {
        'planar_2dof': ours(planar_2dof),
        'planar_2dof warm': ours(planar_2dof, Knowledge(deviation=NEAR)),
        'soft warm': ours(soft_planar, Knowledge(True, NEAR)),
        'soft calibrated': ours(soft_planar, Knowledge(True)),
        'soft cold': ours(soft_planar),
        'planar_3dof': ours(planar_3dof),
        'lmeds_8pt (paper)': ours(lmeds_8pt),
        **peers(),
    }


def times(trials: int, seed: int, say: Callable[[str], None]) -> list[dict[str, Any]]:
    """Return medians and quartiles [ms] and ratios to OpenCV's LMedS, for each cell."""
    return [_times(name, cell, trials, seed, say) for name, cell in CELLS.items()]


def _times(
    name: str, cell: Cell, trials: int, seed: int, say: Callable[[str], None]
) -> dict[str, Any]:
    pairs = draw_pairs(cell, min(trials, PAIRS), seed)
    taken: dict[str, list[float]] = {who: [] for who in timed()}
    for turn in range(max(1, trials // len(pairs))):
        say(f'time, {name}: turn {turn + 1}')
        for pair in pairs:
            for who, solve in timed().items():  # by turns: a busy moment hits everybody
                began = perf_counter()
                solve(pair, cell)
                taken[who].append(1e3 * (perf_counter() - began))
    reference = np.array(taken[REFERENCE])
    rows = {
        who: {
            'median_ms': float(np.median(each)),
            'quarter_ms': float(np.percentile(each, 25)),
            'three_quarters_ms': float(np.percentile(each, 75)),
            'times_faster': float(np.median(reference / each)),
        }
        for who, each in taken.items()
    }
    return {'cell': name, 'points': cell.points, 'rows': rows}
