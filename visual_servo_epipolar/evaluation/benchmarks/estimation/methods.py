"""
Methods of the estimation benchmark: our estimators and the peers behind one signature; their time.

It is that of the thread on its processor, by turns on each pair: what else the machine does
meanwhile does not count.
"""

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import partial
from importlib import import_module
from importlib.util import find_spec
import math
from time import thread_time
from typing import Any

import cv2
import numpy as np

from visual_servo_epipolar.core.arrays import FloatArray
from visual_servo_epipolar.core.errors import DegenerateGeometryError
from visual_servo_epipolar.core.estimators.base import Attitude, Estimate, Estimator, Prior
from visual_servo_epipolar.core.estimators.lmeds_8pt import lmeds_8pt
from visual_servo_epipolar.core.estimators.planar_2dof import planar_2dof
from visual_servo_epipolar.core.estimators.planar_3dof import planar_3dof
from visual_servo_epipolar.core.estimators.soft_planar import soft_planar
from visual_servo_epipolar.core.geometry.epipolar import Bearings, epipoles
from visual_servo_epipolar.core.geometry.rays import image_points
from visual_servo_epipolar.evaluation.benchmarks.estimation.scenes import (
    Cell,
    draw_pairs,
    FOCAL,
    Pair,
)

ATTITUDE_DEVIATION = math.radians(0.03)  # of tilt and roll of a calibrated camera
JITTER = math.radians(0.1)  # of the floor, as given to soft_planar
PRIOR_DEVIATION = math.radians(3.0)  # of prior bearings
NEAR = math.radians(0.3)  # how far the bearings have moved since the frame before, when timed
GOOD = 0.999
CAMERA = {'model': 'PINHOLE', 'width': 1280, 'height': 1024, 'params': [FOCAL, FOCAL, 0.0, 0.0]}

Solver = Callable[[Pair, Cell], Bearings | None]


@dataclass(frozen=True, slots=True)
class Knowledge:
    """Prior knowledge of an estimator: the attitude of the camera, bearings near the truth."""

    calibrated: bool = False
    deviation: float | None = None  # of bearings drawn around the truth [rad]

    def prior(self, pair: Pair, cell: Cell) -> Prior:
        """Return the prior for ``pair`` of ``cell``."""
        attitude = Attitude(jitter=JITTER)
        if self.calibrated:
            tilt, roll = math.radians(cell.tilt), math.radians(cell.roll)
            deviation = math.hypot(
                ATTITUDE_DEVIATION, JITTER
            )  # the floor moved the desired camera, too
            attitude = Attitude(tilt, roll, deviation, deviation, JITTER)
        if self.deviation is None:
            return Prior(attitude)
        # Seeded by the noise of the first match, so that all methods draw equal bearings.
        seed = np.frombuffer(pair.current[0].tobytes(), np.uint32)
        psi, phi = np.random.default_rng(seed).normal(0.0, self.deviation, 2).tolist()
        before = Bearings(pair.bearings.psi + psi, pair.bearings.phi + phi)
        return Prior(attitude, before, PRIOR_DEVIATION)


def estimate(
    estimator: Estimator, knowledge: Knowledge, pair: Pair, cell: Cell
) -> Estimate | None:
    """Return the estimate, None where the estimator refuses the matches."""
    rng = np.random.default_rng(len(pair.current))
    prior = knowledge.prior(pair, cell)
    try:
        return estimator(pair.current, pair.desired, noise=pair.noise, prior=prior, rng=rng)
    except DegenerateGeometryError:
        return None


def ours(estimator: Estimator, knowledge: Knowledge = Knowledge()) -> Solver:  # noqa: B008
    """Return an estimator of this package as a method of the benchmark."""

    def solve(pair: Pair, cell: Cell) -> Bearings | None:
        answer = estimate(estimator, knowledge, pair, cell)
        return None if answer is None else answer.bearings

    return solve


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
    current, desired = _pixels(pair)
    fundamental, _ = cv2.findFundamentalMat(
        current, desired, method, _threshold(cell), GOOD, 10000
    )
    return _from_fundamental(fundamental)


def _poselib_f(poselib: Any, pair: Pair, cell: Cell) -> Bearings | None:
    options = {'max_epipolar_error': _threshold(cell), 'seed': 0}
    fundamental, _ = poselib.estimate_fundamental(*_pixels(pair), options, {})
    return _from_fundamental(fundamental)


def _poselib_e(poselib: Any, pair: Pair, cell: Cell) -> Bearings | None:
    options = {'max_epipolar_error': _threshold(cell), 'seed': 0}
    pose, _ = poselib.estimate_relative_pose(*_pixels(pair), CAMERA, CAMERA, options, {})
    desired, current = pose.t, -pose.R.T @ pose.t  # x_desired = R x_current + t
    psi = math.atan2(desired[2], desired[0])
    return Bearings(psi, math.atan2(current[0], -current[2]))


def peers() -> Mapping[str, Solver]:
    """Return OpenCV's estimators and, where it is installed, poselib's."""
    solvers: dict[str, Solver] = {
        'opencv LMedS F': partial(_opencv, cv2.FM_LMEDS),
        'opencv MAGSAC F': partial(_opencv, cv2.USAC_MAGSAC),
    }
    if find_spec('poselib') is not None:
        poselib = import_module('poselib')
        solvers['poselib F'] = partial(_poselib_f, poselib)
        solvers['poselib E'] = partial(_poselib_e, poselib)
    return solvers


def methods(deviation: float | None = None) -> Mapping[str, Solver]:
    """Return all methods; ours with prior bearings of ``deviation`` [rad], if it is given."""
    cold, calibrated = Knowledge(deviation=deviation), Knowledge(True, deviation)
    return {
        'lmeds_8pt (paper)': ours(lmeds_8pt),
        'planar_3dof': ours(planar_3dof, cold),
        'planar_2dof': ours(planar_2dof, cold),
        'soft cold': ours(soft_planar, cold),
        'soft calibrated': ours(soft_planar, calibrated),
        **peers(),
    }


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
