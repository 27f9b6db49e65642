"""Estimation benchmark: accuracy, consistency and speed beside OpenCV and poselib."""

from collections.abc import Callable, Iterable, Mapping
from importlib.metadata import version
from importlib.util import find_spec
from itertools import product
import math
from typing import Any

import cv2
import numpy as np

from visual_servo_epipolar.core.arrays import FloatArray
from visual_servo_epipolar.core.estimators.base import Estimator
from visual_servo_epipolar.core.estimators.planar_2dof import planar_2dof
from visual_servo_epipolar.core.estimators.soft_planar import soft_planar
from visual_servo_epipolar.core.geometry.rotation import fit_rotation
from visual_servo_epipolar.evaluation.benchmarks.estimation.methods import (
    estimate,
    Knowledge,
    methods,
    ours,
    peers,
    PRIOR_DEVIATION,
    Solver,
    times,
)
from visual_servo_epipolar.evaluation.benchmarks.estimation.scenes import (
    Cell,
    difference,
    draw_pairs,
    error,
    fisher_information,
    FOCAL,
    Pair,
)

TRIALS, QUICK_TRIALS = 500, 12
BASELINES = (6.0, 3.0, 1.5, 0.75, 0.4, 0.2)  # [m]
REALISTIC: Mapping[str, Any] = {'tilt': 1.0, 'roll': 0.5, 'jitter': 0.1, 'outliers': 0.2}
GROSS = 5.0  # error that counts as a failure [deg]
NO_ANSWER = 90.0  # what a refusal counts as [deg]
CONSISTENCY_PARALLAX = 25.0  # in deviations of the noise
KINDS = ('ideal', 'realistic', 'outliers', 'wall, no prior', 'wall, prior 3 deg')


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
            'bound': [_bound(baseline, trials, seed) for baseline in BASELINES[1:]],
            'honesty': _consistency(trials, seed, say),
            'rivals': [
                _alternatives(name, cell, trials, seed)
                for name, cell in _alternative_cells().items()
            ],
            'signs': [_signs(baseline, trials, seed) for baseline in (0.1, 0.3, 1.0)],
            'degeneracy': [_degeneracy(jitter, trials, seed) for jitter in (0.0, 0.1)],
            'time': times(trials, seed, say),
        }
    finally:
        cv2.setNumThreads(threads)


def _cells() -> list[tuple[str, str, Cell]]:
    """Return kind, name and cell of every row of the accuracy table."""
    cells = [('ideal', f'{b:g} m', Cell(baseline=b)) for b in BASELINES]
    cells += [('realistic', f'{b:g} m', Cell(baseline=b, **REALISTIC)) for b in BASELINES]
    shares = (0.0, 0.2, 0.4)
    cells += [('outliers', f'{s:.0%} at 3 m', Cell(baseline=3.0, outliers=s)) for s in shares]
    walls = ('slanted', 'frontal')
    for kind, scene in product(KINDS[3:], walls):
        cells.append((kind, f'{scene}, 3 m', Cell(baseline=3.0, scene=scene)))
    return cells


def _accuracy(
    kind: str, name: str, cell: Cell, trials: int, seed: int, say: Callable[[str], None]
) -> dict[str, Any]:
    pairs = draw_pairs(cell, trials, seed)
    rows = {}
    deviation = PRIOR_DEVIATION if kind == KINDS[-1] else None
    for method, solve in methods(deviation).items():
        say(f'{kind}, {name}: {method}')
        rows[method] = _summary(np.array([_error(solve, pair, cell) for pair in pairs]))
    return {'kind': kind, 'cell': name, 'rows': rows}


def _error(solve: Solver, pair: Pair, cell: Cell) -> float:
    cv2.setRNGSeed(0)
    bearings = solve(pair, cell)
    return NO_ANSWER if bearings is None else error(bearings, pair.bearings)


def _summary(errors: FloatArray) -> dict[str, float]:
    """Return median, 95th percentile and largest of errors [deg], (N,), and shares of failures."""
    parts = [float(np.median(part)) for part in np.array_split(errors, min(5, len(errors)))]
    return {
        'median_deg': float(np.median(errors)),
        'p95_deg': float(np.percentile(errors, 95)),
        'max_deg': float(errors.max()),
        'gross': float((errors > GROSS).mean()),
        'refused': float((errors == NO_ANSWER).mean()),
        'spread_of_median_deg': max(parts) - min(parts),
    }


def _bound(baseline: float, trials: int, seed: int) -> dict[str, float]:
    """Return the error of planar_2dof in units of the Cramer-Rao bound."""
    cell = Cell(baseline=baseline)
    solve, squared, sizes = ours(planar_2dof), [], []
    for pair in draw_pairs(cell, trials, seed):
        information = fisher_information(pair, cell.ray_noise)
        bearings = solve(pair, cell)
        if bearings is not None:
            deviation = difference(bearings, pair.bearings)
            squared.append(float(deviation @ information @ deviation) / 2.0)
        sizes.append(np.linalg.inv(information).trace() / 2.0)
    return {
        'baseline_m': baseline,
        'bound_deg': math.degrees(math.sqrt(float(np.median(sizes)))),
        **_normalised(squared),
    }


def _normalised(squared: list[float]) -> dict[str, float]:
    """Return the root mean square of normalised errors, whole and without the largest 1 %."""
    trimmed = np.sort(squared)[: max(1, math.ceil(0.99 * len(squared)))]
    return {
        'rms': math.sqrt(float(np.mean(squared))),
        'trimmed_rms': math.sqrt(float(trimmed.mean())),
        'count': len(squared),
    }


def _consistency(trials: int, seed: int, say: Callable[[str], None]) -> list[dict[str, Any]]:
    """Return errors in units of the deviations that the estimators report."""
    cases: list[tuple[str, Estimator, Knowledge, Mapping[str, Any]]] = [
        ('planar_2dof, ideal', planar_2dof, Knowledge(), {}),
        ('soft cold, realistic', soft_planar, Knowledge(), REALISTIC),
        ('soft calibrated, realistic', soft_planar, Knowledge(True), REALISTIC),
    ]
    rows = []
    for (name, estimator, knowledge, conditions), baseline in product(cases, BASELINES[1:4]):
        say(f'covariance: {name}')
        cell = Cell(baseline=baseline, **conditions)
        squared = []
        for pair in draw_pairs(cell, trials, seed):
            if _parallax(pair) < CONSISTENCY_PARALLAX * cell.ray_noise:
                continue
            answer = estimate(estimator, knowledge, pair, cell)
            if answer is not None:
                errors = difference(answer.bearings, pair.bearings)
                squared.append(float(errors @ np.linalg.solve(answer.covariance, errors)) / 2.0)
        rows.append({'case': name, 'baseline_m': baseline, **_normalised(squared)})
    return rows


def _parallax(pair: Pair) -> float:
    return fit_rotation(pair.current, pair.desired).parallax


def _alternative_cells() -> Mapping[str, Cell]:
    return {
        'ideal, 3 m': Cell(baseline=3.0),
        'realistic, 3 m': Cell(baseline=3.0, **REALISTIC),
        'realistic, 0.75 m': Cell(baseline=0.75, **REALISTIC),
        'slanted wall, 3 m': Cell(baseline=3.0, scene='slanted'),
        'frontal wall, 3 m': Cell(baseline=3.0, scene='frontal'),
    }


def _alternatives(name: str, cell: Cell, trials: int, seed: int) -> dict[str, Any]:
    """Return how often a second geometry is reported, and how often one is missed that wins."""
    rows, pairs = {}, draw_pairs(cell, trials, seed)
    for method, estimator in (('planar_2dof', planar_2dof), ('soft cold', soft_planar)):
        estimates = ((estimate(estimator, Knowledge(), pair, cell), pair) for pair in pairs)
        answered = [(e, p) for e, p in estimates if e is not None]
        gross = [e for e, p in answered if error(e.bearings, p.bearings) > GROSS]
        rows[method] = {
            'reported': sum(e.alternative is not None for e, _ in answered) / len(pairs),
            'gross_unreported': sum(e.alternative is None for e in gross) / len(pairs),
        }
    return {'cell': name, 'rows': rows}


def _signs(baseline: float, trials: int, seed: int) -> dict[str, Any]:
    """Return the share of baselines that point the wrong way, all around the goal."""
    cell = Cell(baseline=baseline, noise=0.5, outliers=0.3, around=True)
    solvers = {
        'planar_2dof': ours(planar_2dof),
        'soft cold': ours(soft_planar),
        'soft calibrated': ours(soft_planar, Knowledge(True)),
    }
    solvers |= {method: solve for method, solve in peers().items() if method == 'poselib E'}
    pairs = draw_pairs(cell, 2 * trials, seed)
    return {
        'baseline_m': baseline,
        'trials': len(pairs),
        'flips': {
            method: float(np.mean([_flipped(solve(pair, cell), pair) for pair in pairs]))
            for method, solve in solvers.items()
        },
    }


def _flipped(bearings: Any, pair: Pair) -> bool:
    return bearings is None or math.cos(bearings.psi - pair.bearings.psi) < 0.0


def _degeneracy(jitter: float, trials: int, seed: int) -> dict[str, float]:
    """Return how well parallax tells a baseline of 2 cm from a pure rotation."""
    at_rest = [_parallax(p) for p in draw_pairs(Cell(baseline=0.0, jitter=jitter), trials, seed)]
    moved = [_parallax(p) for p in draw_pairs(Cell(baseline=0.02, jitter=jitter), trials, seed)]
    a, b = np.array(at_rest), np.array(moved)
    return {
        'jitter_deg': jitter,
        'auc': float((b[:, None] > a).mean() + 0.5 * (b[:, None] == a).mean()),
        'still_px': FOCAL * float(np.median(a)),
        'moved_px': FOCAL * float(np.median(b)),
    }


def table(document: Mapping[str, Any]) -> str:
    """Return the document as text: accuracy, bound, honesty, signs, degeneracy, time."""
    versions = ', '.join(f'{name} {v}' for name, v in document['versions'].items() if v)
    lines = [
        f'Estimation: {document["trials"]} trials a cell, 26 points, 0.3 px in both images, '
        f'f = 770 px; {versions}; OpenCV on one thread',
    ]
    if document['versions']['poselib'] is None:
        lines.append('poselib is not installed: its rows are left out (pip install poselib)')
    kinds = dict.fromkeys(it['kind'] for it in document['accuracy'])
    for kind in kinds:
        lines += ['', f'Epipole error, {kind} [deg]: median/p95, and failures above 5 deg [%]']
        lines += _accuracy_rows([it for it in document['accuracy'] if it['kind'] == kind])
    lines += ['', 'Error of planar_2dof in units of the Cramer-Rao bound (ideal scenes)']
    lines += [_bound_row(it) for it in document['bound']]
    lines += ['', 'Error in units of the deviation that is reported, at a parallax above 25 sigma']
    lines += [_consistency_row(it) for it in document['honesty']]
    lines += ['', 'A second geometry reported, and gross errors without one [% of trials]']
    lines += [_alternative_row(it) for it in document['rivals']]
    lines += ['', 'Baseline reversed (0.5 px, 30 % outliers, all around the goal) [%]']
    lines += [_sign_row(it) for it in document['signs']]
    lines += ['', 'Pure rotation against a baseline of 2 cm, by the parallax of fit_rotation']
    lines += [_degeneracy_row(it) for it in document['degeneracy']]
    for it in document['time']:
        lines += ['', f'Time, {it["points"]} points, {it["cell"]}; ratio to OpenCV LMedS by pairs']
        lines += [_time_row(method, row) for method, row in it['rows'].items()]
    return '\n'.join(lines)


def _accuracy_rows(cells: Iterable[Mapping[str, Any]]) -> list[str]:
    cells = list(cells)
    lines = [' ' * 20 + ''.join(f'{it["cell"]:>20}' for it in cells)]
    for method in cells[0]['rows']:
        lines.append(f'  {method:<18}' + ''.join(_cell(it['rows'][method]) for it in cells))
    return lines


def _cell(row: Mapping[str, float]) -> str:
    gross = f'({100 * row["gross"]:.1f})' if row['gross'] else ''
    return f'{_degrees(row["median_deg"])}/{_degrees(row["p95_deg"])}{gross:>7}'.rjust(20)


def _degrees(value: float) -> str:
    return f'{value:.3f}' if value < 1.0 else f'{value:.2f}' if value < 10.0 else f'{value:.0f}'


def _bound_row(it: Mapping[str, Any]) -> str:
    return (
        f'  {it["baseline_m"]:g} m: bound {it["bound_deg"]:.3f} deg, rms {it["rms"]:.3f}, '
        f'less the largest 1 % {it["trimmed_rms"]:.3f}'
    )


def _consistency_row(it: Mapping[str, Any]) -> str:
    return (
        f'  {it["case"]:<28}{it["baseline_m"]:>5g} m: rms {it["rms"]:.2f}, less the largest 1 % '
        f'{it["trimmed_rms"]:.2f}, of {it["count"]}'
    )


def _alternative_row(it: Mapping[str, Any]) -> str:
    rows = '   '.join(
        f'{method} {100 * row["reported"]:.1f} and {100 * row["gross_unreported"]:.1f}'
        for method, row in it['rows'].items()
    )
    return f'  {it["cell"]:<20}{rows}'


def _sign_row(it: Mapping[str, Any]) -> str:
    flips = '   '.join(f'{method} {100 * share:.1f}' for method, share in it['flips'].items())
    return f'  {it["baseline_m"]:g} m, {it["trials"]} trials:  {flips}'


def _degeneracy_row(it: Mapping[str, Any]) -> str:
    return (
        f'  jitter {it["jitter_deg"]:g} deg: AUC {it["auc"]:.4f}; parallax {it["still_px"]:.2f} '
        f'px at rest, {it["moved_px"]:.2f} px moved'
    )


def _time_row(method: str, row: Mapping[str, float]) -> str:
    return (
        f'  {method:<20}{row["median_ms"]:7.2f} ms  (quartiles {row["quarter_ms"]:.2f} to '
        f'{row["three_quarters_ms"]:.2f})  {row["times_faster"]:6.1f} times faster'
    )
