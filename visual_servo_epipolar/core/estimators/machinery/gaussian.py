"""Gaussian priors of parameters, and the posterior that data and prior make together."""

from typing import NamedTuple

import numpy as np

from visual_servo_epipolar.core.arrays import BoolArray, FloatArray
from visual_servo_epipolar.core.errors import DegenerateGeometryError
from visual_servo_epipolar.core.geometry.motion import HALF_PI

UNDETERMINED = 1.0  # deviation of a bearing above which the matches say nothing of it [rad]


class GaussianPrior(NamedTuple):
    """Gaussian prior of P parameters: mean, shape (..., P), and information, (..., P, P)."""

    mean: FloatArray
    information: FloatArray


class Posterior(NamedTuple):
    """
    Parameters, (..., P), psi and phi first, combined with the last bearings.

    ``covariance``, (..., P, P), is that of the matches alone; ``determined``, (...), says where
    they fix the bearings at all.
    """

    parameters: FloatArray
    covariance: FloatArray
    determined: BoolArray


def posterior(
    parameters: FloatArray,
    covariance: FloatArray,
    before: FloatArray,
    deviation: FloatArray | float,
) -> Posterior:
    """
    Combine the estimated ``parameters``, shape (..., P), with the last bearings.

    By as much as the matches leave open: where they fix the bearings this changes nothing, where
    a plane nearly hides them it helps. ``covariance`` has shape (..., P, P); ``before``, shape
    (..., 2), is nan where nothing is known, and is known to ``deviation``, (...).
    """
    variances = covariance.diagonal(axis1=-2, axis2=-1)
    change = np.remainder(before - parameters[..., :2] + HALF_PI, np.pi) - HALF_PI
    change[np.isnan(change)] = 0.0
    # (covariance + deviation^2 I)^-1 change, by the adjugate
    spare = np.asarray(deviation * deviation)[..., None]
    own, both = variances[..., :2] + spare, covariance[..., 0, 1][..., None]
    pull = own[..., ::-1] * change - both * change[..., ::-1]
    pull /= own[..., :1] * own[..., 1:] - both * both
    drawn = parameters + (covariance[..., :2] @ pull[..., None])[..., 0]
    return Posterior(drawn, covariance, is_determined(covariance))


def is_determined(covariance: FloatArray) -> BoolArray:
    """Return where the matches fix psi and phi; ``covariance`` has shape (..., P, P)."""
    variances = covariance.diagonal(axis1=-2, axis2=-1)
    positive = np.minimum.reduce(variances, axis=-1) > 0.0
    largest = np.maximum.reduce(variances[..., :2], axis=-1)
    return np.asarray(positive & (largest < UNDETERMINED**2))


def undetermined() -> DegenerateGeometryError:
    """Return what is raised where the matches leave a bearing open altogether."""
    return DegenerateGeometryError(
        'the matches leave the bearings open: there is no baseline, or all of them lie on the '
        "horizon or on one line; track features above and below the camera's height"
    )
