"""Statistics: confidence intervals of success rates and of quantiles."""

from collections.abc import Sequence
import math

import numpy as np

from visual_servo_epipolar.core.arrays import FloatArray

Z = 1.959963984540054  # of the standard normal: 95 % lie within
RESAMPLES = 1000
BOOTSTRAP_SEED = 7
BLOCK = 1_000_000  # values drawn at a time: that many fit in memory whatever the sweep

Interval = tuple[float, float]


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


def quantile_interval(values: Sequence[float] | FloatArray, share: float) -> Interval:
    """
    Return the 95 % percentile-bootstrap interval of a quantile of ``values``, shape (N,).

    The resamples are drawn from a fixed seed: the interval follows from the values alone. It is
    nan if N is 0.
    """
    if not len(values):
        return math.nan, math.nan
    data, rng = np.asarray(values, dtype=np.float64), np.random.default_rng(BOOTSTRAP_SEED)
    block = max(1, BLOCK // len(data))
    counts = [min(block, remaining) for remaining in range(RESAMPLES, 0, -block)]
    resampled = [
        np.quantile(data[rng.integers(len(data), size=(count, len(data)))], share, 1)
        for count in counts
    ]
    low, high = np.quantile(np.concatenate(resampled), (0.025, 0.975)).tolist()
    return low, high
