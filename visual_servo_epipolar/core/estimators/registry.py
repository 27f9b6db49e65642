"""The estimators by the names that settings give them, for one pair of views or for many."""

from collections.abc import Callable, Sequence

import numpy as np

from visual_servo_epipolar.core.arrays import FloatArray
from visual_servo_epipolar.core.errors import DegenerateGeometryError
from visual_servo_epipolar.core.estimators.base import Estimate, Estimator, Prior
from visual_servo_epipolar.core.estimators.lmeds_8pt import lmeds_8pt
from visual_servo_epipolar.core.estimators.machinery.batch import Answer
from visual_servo_epipolar.core.estimators.planar_2dof import planar_2dof, planar_2dof_each
from visual_servo_epipolar.core.estimators.planar_3dof import planar_3dof
from visual_servo_epipolar.core.estimators.soft_planar import soft_planar, soft_planar_each
from visual_servo_epipolar.core.estimators.soft_uncalibrated import soft_uncalibrated_each

ESTIMATORS: dict[str, Estimator] = {
    'lmeds_8pt': lmeds_8pt,
    'planar_3dof': planar_3dof,
    'planar_2dof': planar_2dof,
    'soft_planar': soft_planar,
}
# Those that take many pairs of views at once, and need no chance.
EACH: dict[str, Callable[..., list[Answer]]] = {
    'planar_2dof': planar_2dof_each,
    'soft_planar': soft_planar_each,
}
# The same where the focal length is not known.
EACH_UNCALIBRATED = {'soft_planar': soft_uncalibrated_each}


def estimate(
    name: str,
    current: FloatArray,
    desired: FloatArray,
    *,
    noise: float,
    prior: Prior,
    seed: tuple[int, int],
) -> Estimate:
    """
    Return what estimator ``name`` finds in one pair of views, rays of shape (N, 2).

    ``noise`` is the deviation of a ray coordinate; ``seed`` fixes every random choice.

    Raises
    ------
    DegenerateGeometryError
        When the matches cannot answer.

    """
    answer = estimates(
        name,
        current[None],
        desired[None],
        noise=np.array([noise]),
        priors=[prior],
        seeds=[seed],
    )[0]
    if isinstance(answer, DegenerateGeometryError):
        raise answer
    return answer


def estimates(
    name: str,
    current: FloatArray,
    desired: FloatArray,
    *,
    noise: FloatArray,
    priors: Sequence[Prior],
    seeds: Sequence[tuple[int, int]],
) -> list[Answer]:
    """
    Return what estimator ``name`` finds in each pair of views, or the error that says why not.

    Rays have shape (B, N, 2), ``noise`` (B,); the ``seeds`` fix every random choice. Either all
    cameras are calibrated or none is.
    """
    if not priors[0].lens.calibrated and name in EACH_UNCALIBRATED:
        return EACH_UNCALIBRATED[name](current, desired, noise=noise, priors=priors)
    if name in EACH:
        return EACH[name](current, desired, noise=noise, priors=priors)
    found: list[Answer] = []
    for k, (prior, seed) in enumerate(zip(priors, seeds, strict=True)):
        try:
            answer = ESTIMATORS[name](
                current[k],
                desired[k],
                noise=float(noise[k]),
                prior=prior,
                rng=np.random.default_rng(seed),
            )
        except DegenerateGeometryError as error:
            found.append(error)
        else:
            found.append(answer)
    return found
