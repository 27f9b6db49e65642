"""
Time of the estimators and of the peers, by turns on each pair of views.

It is that of the thread on its processor: what else the machine does meanwhile does not count.
"""

from collections.abc import Callable, Mapping
from functools import partial
from time import thread_time
from typing import Any

import numpy as np

from visual_servo_epipolar.core.estimators.base import Estimator
from visual_servo_epipolar.core.estimators.lmeds_8pt import lmeds_8pt
from visual_servo_epipolar.core.estimators.planar_2dof import planar_2dof
from visual_servo_epipolar.core.estimators.planar_3dof import planar_3dof
from visual_servo_epipolar.core.estimators.soft_planar import soft_planar
from visual_servo_epipolar.evaluation.benchmarks.estimation.methods import (
    Knowledge,
    NEAR,
    peers,
)
from visual_servo_epipolar.evaluation.benchmarks.estimation.scenes import Cell, draw_pairs, Pair

REFERENCE = 'opencv LMedS F'
PAIRS = 40
CELLS: Mapping[str, Cell] = {
    'ideal, 3 m': Cell(baseline=3.0),
    'realistic, 3 m': Cell(baseline=3.0, tilt=1.0, roll=0.5, jitter=0.1, outliers=0.2),
}
# Our estimators and their prior knowledge; `warm` has the bearings of the frame before.
OURS: Mapping[str, tuple[Estimator, Knowledge]] = {
    'planar_2dof': (planar_2dof, Knowledge()),
    'planar_2dof warm': (planar_2dof, Knowledge(deviation=NEAR)),
    'soft warm': (soft_planar, Knowledge(True, NEAR)),
    'soft calibrated': (soft_planar, Knowledge(True)),
    'soft cold': (soft_planar, Knowledge()),
    'planar_3dof': (planar_3dof, Knowledge()),
    'lmeds_8pt (paper)': (lmeds_8pt, Knowledge()),
}


def _calls(pair: Pair, cell: Cell) -> Mapping[str, Callable[[], object]]:
    """Return what is timed on one pair of views."""
    calls: dict[str, Callable[[], object]] = {}
    for method, (estimator, knowledge) in OURS.items():
        calls[method] = partial(
            estimator,
            pair.current,
            pair.desired,
            noise=pair.noise,
            prior=knowledge.prior(pair, cell),
            rng=np.random.default_rng(0),
        )
    return calls | {method: partial(solve, pair, cell) for method, solve in peers().items()}


def times(trials: int, seed: int, say: Callable[[str], None]) -> list[dict[str, Any]]:
    """Return medians and quartiles [ms] and ratios to OpenCV's LMedS, for each cell."""
    return [_times(name, cell, trials, seed, say) for name, cell in CELLS.items()]


def _times(
    name: str, cell: Cell, trials: int, seed: int, say: Callable[[str], None]
) -> dict[str, Any]:
    calls = [_calls(pair, cell) for pair in draw_pairs(cell, min(trials, PAIRS), seed)]
    durations: dict[str, list[float]] = {method: [] for method in calls[0]}
    for turn in range(max(1, trials // len(calls))):
        say(f'time, {name}: turn {turn + 1}')
        for each in calls:
            for method, call in each.items():  # by turns: a busy moment hits everybody
                began = thread_time()
                call()
                durations[method].append(1e3 * (thread_time() - began))
    reference = np.array(durations[REFERENCE])
    rows = {
        method: {
            'median_ms': float(np.median(milliseconds)),
            'quarter_ms': float(np.percentile(milliseconds, 25)),
            'three_quarters_ms': float(np.percentile(milliseconds, 75)),
            'times_faster': float(np.median(reference / milliseconds)),
        }
        for method, milliseconds in durations.items()
    }
    return {'cell': name, 'points': cell.points, 'rows': rows}
