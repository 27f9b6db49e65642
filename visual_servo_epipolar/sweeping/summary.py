"""Summary of a sweep: the JSON document of the command line, for each law."""

from collections import Counter
from collections.abc import Iterable, Mapping, Sequence
import math
import re
from statistics import NormalDist
from typing import Any

import numpy as np

from visual_servo_epipolar.core.arrays import FloatArray
from visual_servo_epipolar.core.servo.run_log import kind
from visual_servo_epipolar.sweeping.plan import SweepPlan
from visual_servo_epipolar.sweeping.store import Store

Result = Mapping[str, Any]
SPREADS = (  # of the runs that arrived
    *('position_error_m', 'lateral_error_m', 'longitudinal_error_m', 'heading_error_deg'),
    *('max_distance_ratio', 'duration_s', 'path_length_m', 'attempts', 'time_ratio'),
    *('standstills', 'phase_changes', 'peak_jerk_m_s3', 'peak_jerk_rad_s3'),
)
# Of all runs, not of those that arrived: a robot that drives off must not be left out.
SAFETY = {
    'wrong_geometry_s': 'wrong_geometry_s',
    'excursion': 'max_distance_ratio',
    'standing_s': 'standing_s',
    'reversals_v': 'v',
    'reversals_w': 'w',
}
ARRIVALS = ('arrived', 'wrong')  # by what the robot reports
Z = NormalDist().inv_cdf(0.975)  # 95 % lie within
Interval = tuple[float, float]


def summaries(plan: SweepPlan, store: Store) -> dict[str, dict[str, Any]]:
    """Return law -> document, each with its runs in the order of their indices."""
    return {
        law: {
            **summary_of([store.results[law, index] for index in range(plan.runs)]),
            'wall_s': store.wall_s,
            'sweep': _describe(plan, store, law),
        }
        for law in plan.laws
    }


def summary_of(runs: Sequence[Result]) -> dict[str, Any]:
    """Return rates, errors and efforts of runs of one law, as the JSON of a sweep has them."""
    kinds = [kind(run) for run in runs]
    arrivals = [run for run, it in zip(runs, kinds, strict=True) if it in ARRIVALS]
    failures = [run for run, it in zip(runs, kinds, strict=True) if it not in ARRIVALS]
    every = [{**run, **(run.get('reversals') or {})} for run in runs]
    return {
        'success_rate': len(arrivals) / len(runs),
        'success_interval': list(wilson(len(arrivals), len(runs))),
        'arrived': len(arrivals),
        'arrived_but_wrong': kinds.count('wrong'),
        'defects': kinds.count('raised'),
        'failure_reasons': reasons(failures),
        **{name: _spread(arrivals, name) for name in SPREADS},
        **{key: _spread(every, name) for key, name in SAFETY.items()},
        'runs': list(runs),
    }


def reasons(failures: Iterable[Result]) -> dict[str, int]:
    """Count the reasons, most frequent first; those that differ in their numbers are one."""
    # `23 features, 26 needed` and `25 features, 26 needed` become `N features, N needed`.
    texts = (re.sub(r'-?\d+(\.\d+)?', 'N', failure['reason']) for failure in failures)
    return dict(sorted(Counter(texts).items(), key=lambda item: (-item[1], item[0])))


def _spread(runs: Sequence[Result], name: str) -> dict[str, Any]:
    # A quantity that a run of an earlier version does not have is none, like that of a defect.
    values = [abs(run[name]) for run in runs if run.get(name) is not None]
    return {
        'median': quantile(values, 0.5),
        'p95': quantile(values, 0.95),
        'max': quantile(values, 1.0),
    }


def _describe(plan: SweepPlan, store: Store, law: str) -> dict[str, Any]:
    header = store.header
    return {
        'region': plan.region,
        'source': plan.source,
        'scenario': plan.scenario_name,
        'law': law,
        'seed': plan.seed,
        'command': plan.command(),
        'version': header['version'],
        'commit': header['commit'],
        'begun': header['begun'],
    }


def wilson(successes: int, trials: int) -> Interval:
    """Return Wilson's 95 % interval of the success rate (JASA 1927); all of [0, 1] if no trial."""
    if trials == 0:
        return 0.0, 1.0
    share, z2 = successes / trials, Z * Z / trials
    middle = (share + 0.5 * z2) / (1.0 + z2)
    reach = Z / (1.0 + z2) * math.sqrt((share * (1.0 - share) + 0.25 * z2) / trials)
    # Rounding must not exclude what was seen.
    return min(max(0.0, middle - reach), share), max(min(1.0, middle + reach), share)


def quantile(values: Sequence[float] | FloatArray, share: float) -> float:
    """Return the quantile of ``values``, shape (N,), linear between two; nan if N is 0."""
    return float(np.quantile(values, share)) if len(values) else math.nan
