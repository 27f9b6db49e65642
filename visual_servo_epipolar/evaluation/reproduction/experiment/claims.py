"""Claims of section VIII on the experiment, each beside our run."""

from collections.abc import Mapping, Sequence
import math
from statistics import median
from typing import Any

import numpy as np

from visual_servo_epipolar.core.arrays import FloatArray
from visual_servo_epipolar.core.servo.run_log import seconds
from visual_servo_epipolar.evaluation.reproduction.experiment.experiment import (
    Experiment,
    FEATURES,
    FOCAL_PX,
    from_points,
    PERIOD_S,
    PRINTED_K_T,
    servo,
    START,
    WORKING_K_T,
)
from visual_servo_epipolar.evaluation.reproduction.experiment.figures import (
    difference_decay,
    LEAST,
    signal,
    split,
)
from visual_servo_epipolar.evaluation.reproduction.statements import NO_NUMBER, Statement

ERROR_OF_THE_PAPER_M = 0.04
ZERO_PX = 10.0  # an epipole this near the principal point counts as zero: 0.7 deg


BEHIND = (2.6, -3.0, 0.0)  # behind the goal, with both epipoles out of the image
VARIANTS: Mapping[str, Mapping[str, Any]] = {  # of the servo, each driven on points from START
    'as printed': {},
    'true sigma': {'law': 'corrected'},
    'printed k_t': {'k_t': PRINTED_K_T * FOCAL_PX**2},
}
SEEDS = range(3)
Runs = Mapping[str, Sequence[Mapping[str, Any]]]


def point_runs() -> Runs:
    """Return the results of VARIANTS by seeds, and of 'paper' and 'corrected' from BEHIND."""
    ahead = {
        name: [from_points(START, seed, **changes) for seed in SEEDS]
        for name, changes in VARIANTS.items()
    }
    return ahead | {law: [from_points(BEHIND, law=law)] for law in ('paper', 'corrected')}


def claims(experiment: Experiment, runs: Runs) -> list[Statement]:
    """Return the statements on the experiment; ``runs`` are those of ``point_runs``."""
    return [
        _beginning(experiment, runs),
        *_first_step(experiment),
        *_second_step(experiment),
        _printed_gain(experiment, runs['printed k_t']),
        _error(experiment),
        _signs(runs),
    ]


def _beginning(experiment: Experiment, runs: Runs) -> Statement:
    (paper,), (corrected,) = runs['paper'], runs['corrected']
    first = next(s for s in experiment.log.samples if not math.isnan(s.epipole_current))
    camera = experiment.camera
    edge = max(camera.principal_u, camera.width - camera.principal_u)
    return Statement(
        'Fig. 19',
        'both epipoles are outside the image at the initial position; the text gives no start',
        f'{first.epipole_current:.0f} and {first.epipole_desired:.0f} px from the principal '
        f'point, the edge at {edge:.0f}. Start ours: {START[0]:g} m, {START[1]:g} m, '
        f'{START[2]:g} deg, ahead of the goal as in section VII. From behind it '
        f'({BEHIND[0]:g} m, {BEHIND[1]:g} m) the printed sign fails ({paper["reason"]}), '
        f'and the true one backs off to {corrected["max_distance_ratio"]:.1f} times '
        'the distance',
        bool(min(abs(first.epipole_current), abs(first.epipole_desired)) > edge),
    )


def _first_step(experiment: Experiment) -> list[Statement]:
    log, count = experiment.log, split(experiment.log)
    time = np.array(seconds(log))[:count]
    current, desired = (
        signal(log, name)[:count] for name in ('epipole_current', 'epipole_desired')
    )
    last = float(np.abs([np.median(current[-5:]), np.median(desired[-5:])]).max())
    zero_desired, zero_current = _first_zero(time, desired), _first_zero(time, current)
    unseen = int(np.isnan(current).sum())
    return [
        Statement(
            'Fig. 17',
            'both epipoles are driven to zero',
            f'within {last:.1f} px of the principal point after {time[-1]:.1f} s',
            last < ZERO_PX,
        ),
        Statement(
            'Fig. 17',
            f'e_du is zeroed in finite time; {NO_NUMBER}',
            f'crosses zero at {zero_desired:.1f} s, with u_1 = 0 from there on',
            math.isfinite(zero_desired),
        ),
        Statement(
            'Fig. 17',
            f'so is e_au, as slow turns are raised above the dead zone; {NO_NUMBER}',
            f'crosses zero at {zero_current:.1f} s',
            math.isfinite(zero_current),
        ),
        Statement(
            'VIII',
            'degeneracies of the estimate were never met, with '
            f'{FEATURES} features, LMedS and {PERIOD_S:g} s',
            f'{unseen} of {count} frames of the first step gave no epipoles. Our features are '
            'chosen for their different depths: LMedS fails where one plane holds most of them',
            unseen == 0,
        ),
    ]


def _first_zero(time: FloatArray, values: FloatArray) -> float:
    """Return when ``values`` first left the side they began on [s]; inf if never."""
    crossed = np.flatnonzero(values * values[0] <= 0.0)
    near = np.flatnonzero(np.abs(values) < 2.0)  # what the servo calls zero at this noise [px]
    both = np.concatenate([crossed, near])
    return float(time[both.min()]) if len(both) else math.inf


def _second_step(experiment: Experiment) -> list[Statement]:
    log, first = experiment.log, split(experiment.log)
    fit, values = difference_decay(log), signal(log, 'feature_difference')[first:]
    gaps = [np.linalg.norm(f.current - f.desired, axis=1) for f in experiment.features]
    scatter = float(np.std(np.diff(values[-40:]))) / math.sqrt(2.0)
    return [
        Statement(
            'Fig. 18',
            f'D decreases exponentially; {NO_NUMBER}',
            f'from {values[0]:.0f} px^2 at a fitted rate of {fit.rate:.3f} /s, log misfit '
            f'{fit.misfit:.2f}',
            bool(fit.rate > 0.0 and fit.misfit < 0.3),
        ),
        Statement(
            'Fig. 18',
            'D does not decrease exactly to zero, by floor irregularities and wheel slippage',
            f'in the end it scatters by {scatter:.0f} px^2 from frame to frame',
            scatter > 0.0,
        ),
        Statement(
            'Fig. 20',
            'the actual feature points converge to their target',
            f'median distance from {np.median(gaps[first]):.0f} px to '
            f'{np.median(gaps[-1]):.1f} px',
            bool(np.median(gaps[-1]) < 0.05 * np.median(gaps[first])),
        ),
    ]


def _printed_gain(experiment: Experiment, runs: Sequence[Mapping[str, Any]]) -> Statement:
    start = abs(float(signal(experiment.log, 'feature_difference')[split(experiment.log)]))
    speed = servo().max_linear
    arrived = sum(run['outcome'] == 'arrived' for run in runs)
    return Statement(
        'Fig. 18',
        f'D decreases exponentially with k_t = {PRINTED_K_T:g}, lengths in pixels',
        f'such a k_t asks for {PRINTED_K_T * start:.0f} m/s at first. At {speed:g} m/s u_1 is at '
        f'its limit until |D| = {speed / PRINTED_K_T:.0f} px^2, from {start:.0f}: D falls at the '
        f'pace of the robot ({arrived} of {len(runs)} such runs come to rest). Fig. 18 '
        f'is for k_t = {WORKING_K_T:g}; {PRINTED_K_T:g} would do for plain instead of squared '
        'norms',
        bool(speed / PRINTED_K_T > LEAST * start),
    )


def _error(experiment: Experiment) -> Statement:
    final = experiment.log.samples[-1].pose
    return Statement(
        'VIII',
        'the positioning error is about 4 cm',
        f'{100.0 * final.distance:.1f} cm ({1e3 * final.x:+.1f} mm lateral, {1e3 * final.y:+.1f} '
        f'mm longitudinal), {math.degrees(final.heading_error):+.2f} deg',
        final.distance < ERROR_OF_THE_PAPER_M,
    )


def _signs(runs: Runs) -> Statement:
    printed, true = (
        median(run['position_error_m'] for run in runs[name])
        for name in ('as printed', 'true sigma')
    )
    return Statement(
        'sign',
        'sigma = sign(e_au e_du)',
        'from this start it is the true sigma until e_du is zero, and the servo then sets u_1 = 0 '
        f'for good: median error {1e3 * printed:.1f} mm as printed, {1e3 * true:.1f} mm with the '
        'true sigma (point features)',
        math.isclose(printed, true, abs_tol=0.005)
        and all(run['outcome'] == 'arrived' for run in runs['as printed']),
    )
