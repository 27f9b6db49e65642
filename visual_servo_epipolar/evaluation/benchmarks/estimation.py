"""
Estimation benchmark: accuracy and speed of our estimators, OpenCV's and poselib's.

Time is that of the thread on its processor, alternating on each pair: what else the machine does
meanwhile does not count.
"""

from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass
from functools import partial
from importlib import import_module
from importlib.metadata import version
from importlib.util import find_spec
from itertools import product
import math
from time import thread_time
from typing import Any

import cv2
import numpy as np

from visual_servo_epipolar.core.arrays import FloatArray
from visual_servo_epipolar.core.errors import DegenerateGeometryError
from visual_servo_epipolar.core.geometry.epipolar import Bearings, epipoles
from visual_servo_epipolar.core.geometry.rays import image_points
from visual_servo_epipolar.core.twoview.estimator import Attitude, Estimate, Estimator, Prior
from visual_servo_epipolar.core.twoview.lmeds_8pt import lmeds_8pt
from visual_servo_epipolar.core.twoview.soft_planar import soft_planar
from visual_servo_epipolar.evaluation.benchmarks.scenes import (
    Cell,
    draw_pairs,
    error,
    FOCAL,
    Pair,
)
from visual_servo_epipolar.evaluation.tables import aligned

TRIALS, QUICK_TRIALS = 500, 12
BASELINES = (6.0, 3.0, 1.5, 0.75, 0.4, 0.2)  # [m]
REALISTIC: Mapping[str, Any] = {'tilt': 1.0, 'roll': 0.5, 'jitter': 0.1, 'outliers': 0.2}
CONDITIONS: Mapping[str, Mapping[str, Any]] = {'ideal': {}, 'realistic': REALISTIC}
GROSS = 5.0  # error that counts as a failure [deg]
NO_ANSWER = 90.0  # what a refusal counts as [deg]
REFERENCE = 'opencv LMedS F'  # of times

Solver = Callable[[Pair, Cell], Bearings | None]


@dataclass(frozen=True, slots=True)
class Knowledge:
    """Prior knowledge of an estimator: the attitude of the camera, bearings near the truth."""

    calibrated: bool = False
    deviation: float | None = None  # of bearings drawn around the truth [rad]

    def prior(self, pair: Pair, cell: Cell) -> Prior:
        """Return the prior for ``pair`` of ``cell``: the floor moved the desired camera, too."""
        jitter = math.radians(0.1)
        attitude = Attitude(jitter=jitter)
        if self.calibrated:
            tilt, roll = math.radians(cell.tilt), math.radians(cell.roll)
            deviation = math.hypot(math.radians(0.03), jitter)
            attitude = Attitude(tilt, roll, deviation, deviation, jitter)
        if self.deviation is None:
            return Prior(attitude)
        # Seeded by the noise of the first match, so that all methods draw equal bearings.
        seed = np.frombuffer(pair.current[0].tobytes(), np.uint32)
        psi, phi = np.random.default_rng(seed).normal(0.0, self.deviation, 2).tolist()
        before = Bearings(pair.bearings.psi + psi, pair.bearings.phi + phi)
        return Prior(attitude, before, math.radians(3.0))


WARM = math.radians(0.3)  # how far the bearings have moved since the frame before
OURS: Mapping[str, tuple[Estimator, Knowledge]] = {
    'lmeds_8pt (paper)': (lmeds_8pt, Knowledge()),
    'soft cold': (soft_planar, Knowledge()),
    'soft calibrated': (soft_planar, Knowledge(calibrated=True)),
    'soft warm': (soft_planar, Knowledge(True, WARM)),
}


def estimate(method: str, pair: Pair, cell: Cell) -> Estimate | None:
    """Return the estimate of one of OURS, None where it refuses the matches."""
    estimator, knowledge = OURS[method]
    rng, prior = np.random.default_rng(len(pair.current)), knowledge.prior(pair, cell)
    try:
        return estimator(pair.current, pair.desired, noise=pair.noise, prior=prior, rng=rng)
    except DegenerateGeometryError:
        return None


def _bearings(method: str, pair: Pair, cell: Cell) -> Bearings | None:
    answer = estimate(method, pair, cell)
    return None if answer is None else answer.bearings


def _pixels(pair: Pair) -> tuple[FloatArray, FloatArray]:
    """Return the matches as centred pixels, shape (N, 2) each."""
    return FOCAL * image_points(pair.current), FOCAL * image_points(pair.desired)


def _threshold(cell: Cell) -> float:
    return max(3.0 * cell.noise, 0.6)


def _from_fundamental(fundamental: Any) -> Bearings | None:
    """Return the axes of the bearings, sign free, of F for centred pixels."""
    if fundamental is None or np.shape(fundamental) != (3, 3):
        return None
    scale = np.diag([FOCAL, FOCAL, 1.0])
    e_current, e_desired = epipoles(scale @ np.asarray(fundamental) @ scale)
    psi = math.atan2(e_desired[2], e_desired[0])
    return Bearings(psi, math.atan2(e_current[0], -e_current[2]))


def _opencv(method: int, pair: Pair, cell: Cell) -> Bearings | None:
    cv2.setRNGSeed(0)
    return _from_fundamental(
        cv2.findFundamentalMat(*_pixels(pair), method, _threshold(cell), 0.999, 10000)[0]
    )


def _poselib(poselib: Any, pair: Pair, cell: Cell) -> Bearings | None:
    options = {'max_epipolar_error': _threshold(cell), 'seed': 0}
    params = [FOCAL, FOCAL, 0.0, 0.0]
    camera = {'model': 'PINHOLE', 'width': 1280, 'height': 1024, 'params': params}
    pose, _ = poselib.estimate_relative_pose(*_pixels(pair), camera, camera, options, {})
    desired, current = pose.t, -pose.R.T @ pose.t  # x_desired = R x_current + t
    psi = math.atan2(desired[2], desired[0])
    return Bearings(psi, math.atan2(current[0], -current[2]))


def peers() -> Mapping[str, Solver]:
    """Return OpenCV's estimators and, where it is installed, poselib's."""
    solvers: dict[str, Solver] = {
        REFERENCE: partial(_opencv, cv2.FM_LMEDS),
        'opencv MAGSAC F': partial(_opencv, cv2.USAC_MAGSAC),
    }
    if find_spec('poselib') is not None:
        solvers['poselib E'] = partial(_poselib, import_module('poselib'))
    return solvers


def methods(*, warm: bool = False) -> Mapping[str, Solver]:
    """Return all methods; if ``warm``, those with the bearings of the frame before as well."""
    names = [name for name in OURS if warm or not name.endswith('warm')]
    return {**{name: partial(_bearings, name) for name in names}, **peers()}


def run(*, seed: int, quick: bool, say: Callable[[str], None]) -> dict[str, Any]:
    """Return the document of the benchmark; ``say`` takes the progress."""
    trials = QUICK_TRIALS if quick else TRIALS
    threads = cv2.getNumThreads()
    cv2.setNumThreads(1)
    try:
        return {
            'seed': seed,
            'trials': trials,
            'versions': {
                'numpy': np.__version__,
                'cv2': cv2.__version__,
                'poselib': version('poselib') if find_spec('poselib') else None,
            },
            'accuracy': [_accuracy(*cell, trials, seed, say) for cell in _cells()],
            'signs': [_signs(baseline, trials, seed) for baseline in (0.1, 0.3, 1.0)],
            'time': [
                _times(f'{kind}, 3 m', Cell(baseline=3.0, **more), trials, seed, say)
                for kind, more in CONDITIONS.items()
            ],
        }
    finally:
        cv2.setNumThreads(threads)


def _cells() -> Iterator[tuple[str, str, Cell]]:
    """Yield kind, name and cell of every column of the tables of accuracy."""
    for kind, conditions in CONDITIONS.items():
        for baseline in BASELINES:
            yield kind, f'{baseline:g} m', Cell(baseline=baseline, **conditions)
    for scene in ('slanted', 'frontal'):
        yield 'one wall', f'{scene}, 3 m', Cell(baseline=3.0, scene=scene)


def _accuracy(
    kind: str, name: str, cell: Cell, trials: int, seed: int, say: Callable[[str], None]
) -> dict[str, Any]:
    pairs, rows = draw_pairs(cell, trials, seed), {}
    for method, solve in methods().items():
        say(f'{kind}, {name}: {method}')
        rows[method] = _summary(np.array([_error(solve(pair, cell), pair) for pair in pairs]))
    answers = [estimate('soft cold', pair, cell) for pair in pairs]
    second = sum(it is not None and it.alternative is not None for it in answers)
    rows['soft cold']['second_geometry'] = second / len(pairs)
    return {'kind': kind, 'cell': name, 'rows': rows}


def _error(bearings: Bearings | None, pair: Pair) -> float:
    return NO_ANSWER if bearings is None else error(bearings, pair.bearings)


def _summary(errors: FloatArray) -> dict[str, float]:
    """Return median, 95th percentile and largest of errors [deg], (N,), and shares of failures."""
    return {
        'median_deg': float(np.median(errors)),
        'p95_deg': float(np.percentile(errors, 95)),
        'max_deg': float(errors.max()),
        'gross': float((errors > GROSS).mean()),
        'refused': float((errors == NO_ANSWER).mean()),
    }


def _signs(baseline: float, trials: int, seed: int) -> dict[str, Any]:
    """Return the share of baselines that point the wrong way, all around the goal."""
    cell = Cell(baseline=baseline, noise=0.5, outliers=0.3, around=True)
    pairs, names = draw_pairs(cell, 2 * trials, seed), ('soft cold', 'poselib E')
    flips = {
        method: float(np.mean([_flipped(solve(pair, cell), pair) for pair in pairs]))
        for method, solve in methods().items()
        if method in (*names, 'soft calibrated')
    }
    return {'baseline_m': baseline, 'trials': len(pairs), 'flips': flips}


def _flipped(bearings: Bearings | None, pair: Pair) -> bool:
    return bearings is None or math.cos(bearings.psi - pair.bearings.psi) < 0.0


def _times(
    name: str, cell: Cell, trials: int, seed: int, say: Callable[[str], None]
) -> dict[str, Any]:
    """Return medians and quartiles [ms], and ratios to OpenCV's LMedS."""
    pairs, calls = draw_pairs(cell, min(trials, 40), seed), methods(warm=True)
    durations: dict[str, list[float]] = {method: [] for method in calls}
    for turn in range(max(1, trials // len(pairs))):
        say(f'time, {name}: turn {turn + 1}')
        for pair, (method, call) in product(pairs, calls.items()):  # a busy moment hits everybody
            began = thread_time()
            call(pair, cell)
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


def table(document: Mapping[str, Any]) -> str:
    """Return the document as text: accuracy, signs, time."""
    versions = ', '.join(f'{name} {v}' for name, v in document['versions'].items() if v)
    lines = [
        f'Estimation: {document["trials"]} trials a cell, 26 points, 0.3 px in both images, '
        f'f = 770 px; {versions}; OpenCV on one thread',
    ]
    if document['versions']['poselib'] is None:
        lines.append('poselib is not installed: its rows are left out (pip install poselib)')
    for kind in dict.fromkeys(it['kind'] for it in document['accuracy']):
        cells = [it for it in document['accuracy'] if it['kind'] == kind]
        head = ' | '.join([f'{kind} [deg]', *(it['cell'] for it in cells)])
        rows = ([name, *(_cell(it['rows'][name]) for it in cells)] for name in cells[0]['rows'])
        lines += ['', *aligned(head, rows)]
    lines += ['(median / p95, (failures above 5 deg) and [second geometries] in per cent)', '']
    signs = document['signs']
    head = ' | '.join(['baseline reversed [%]', *(f'{it["baseline_m"]:g} m' for it in signs)])
    rows = (
        [it, *(f'{100 * sign["flips"][it]:.1f}' for sign in signs)] for it in signs[0]['flips']
    )
    lines += aligned(head, rows)
    for it in document['time']:
        head = f'time, {it["cell"]} | median ms | quartiles | times faster than OpenCV LMedS'
        lines += ['', *aligned(head, ([name, *_time(row)] for name, row in it['rows'].items()))]
    return '\n'.join(lines)


def _cell(row: Mapping[str, float]) -> str:
    gross = f' ({100 * row["gross"]:.0f})' if row['gross'] else ''
    second = f' [{100 * row["second_geometry"]:.0f}]' if row.get('second_geometry') else ''
    return f'{row["median_deg"]:.3g} / {row["p95_deg"]:.3g}{gross}{second}'


def _time(row: Mapping[str, float]) -> list[str]:
    quartiles = f'{row["quarter_ms"]:.2f} to {row["three_quarters_ms"]:.2f}'
    return [f'{row["median_ms"]:.2f}', quartiles, f'{row["times_faster"]:.1f}']
