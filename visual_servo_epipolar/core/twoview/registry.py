"""The estimators by the names that settings give them."""

import numpy as np

from visual_servo_epipolar.core.arrays import FloatArray
from visual_servo_epipolar.core.registry import Registry
from visual_servo_epipolar.core.twoview.estimator import Estimate, Estimator, Prior
from visual_servo_epipolar.core.twoview.lmeds_8pt import lmeds_8pt
from visual_servo_epipolar.core.twoview.soft_planar import soft_planar

OWN: dict[str, Estimator] = {
    'lmeds_8pt': lmeds_8pt,
    'soft_planar': soft_planar,
}
ESTIMATORS: Registry[Estimator] = Registry('visual_servo_epipolar.estimators', OWN)
DEFAULT_ESTIMATOR = 'soft_planar'
UNDRAWN = np.random.default_rng(0)  # for what needs no chance


def may_learn_focal(name: str) -> bool:
    """Return whether estimator ``name`` finds the lens out; one of another package may."""
    return name == DEFAULT_ESTIMATOR or name not in OWN


def estimate(
    name: str,
    current: FloatArray,
    desired: FloatArray,
    *,
    noise: FloatArray | float,
    prior: Prior,
    seed: tuple[int, int],
) -> Estimate:
    """
    Return what estimator ``name`` finds in one pair of views, unit rays of shape (N, 3) each.

    ``noise`` is the deviation of their angles [rad]: one number or, of the current and of the
    desired ray of each match, shape (N, 2). The ``seed`` fixes every random choice.

    Raises
    ------
    DegenerateGeometryError
        If the matches cannot answer.

    """
    # To make a source of chance takes as long as two steps of a refinement.
    rng = UNDRAWN if name == DEFAULT_ESTIMATOR else np.random.default_rng(seed)
    return ESTIMATORS[name](current, desired, noise=noise, prior=prior, rng=rng)
