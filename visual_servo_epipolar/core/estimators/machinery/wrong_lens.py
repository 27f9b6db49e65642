"""
Rays of a camera whose matrix is told wrong, and E with its derivatives by what is wrong.

Rays made with a wrong camera matrix are along A^-1 p, A = [[r, 0, h], [0, r, 0], [0, 0, 1]], with
r the focal length that was told over the true one, and h the shift of the principal point along u.
That along v acts as a tilt. So E becomes A^T E A: with D = diag(r, r, 1) and B = D^-1 A, each
element by r to the power of 2, 1 or 0, then h / r times the first row and column to the last ones.
"""

import numpy as np

from visual_servo_epipolar.core.arrays import FloatArray, packed
from visual_servo_epipolar.core.estimators.base import Attitude, Prior
from visual_servo_epipolar.core.estimators.machinery.attitude_prior import attitude_prior
from visual_servo_epipolar.core.estimators.machinery.gaussian import GaussianPrior
from visual_servo_epipolar.core.estimators.machinery.hypotheses import Rays
from visual_servo_epipolar.core.estimators.machinery.tilted_planar import matrices

# Places among the parameters: log r, the rest of h, and k, which is known: h = rest + k log r. The
# prior of log r and h is correlated, that of log r and the rest is not.
RATIO, REST, SLOPE = 6, 7, 8
KNOWN = 1e12  # information of what does not move
POWERS = np.array([2.0, 2.0, 1.0, 2.0, 2.0, 1.0, 1.0, 1.0, 0.0])  # of r, by rows
REACH = 2.0  # how far hypotheses of the focal length reach, in deviations of the prior


def stretch(prior: Prior) -> float:
    """Return by how much true rays may be longer than those that came."""
    return float(np.exp(REACH * prior.lens.ratio_deviation))


def lens_prior(attitude: Attitude, lens: FloatArray) -> GaussianPrior:
    """
    Return what is known of all nine parameters.

    ``lens``, shape (..., 3), are deviations of log r and of the rest of h, and k.
    """
    before = attitude_prior(attitude)
    mean, information = np.zeros((*lens.shape[:-1], 9)), np.zeros((*lens.shape[:-1], 9, 9))
    mean[..., :RATIO], mean[..., SLOPE] = before.mean, lens[..., 2]
    information[..., :RATIO, :RATIO] = before.information
    information[..., RATIO, RATIO] = 1.0 / (lens[..., 0] * lens[..., 0])
    information[..., REST, REST] = 1.0 / (lens[..., 1] * lens[..., 1])
    information[..., SLOPE, SLOPE] = KNOWN
    return GaussianPrior(mean, information)


def corrected(rays: Rays, ratio: FloatArray | float, shift: FloatArray | float) -> Rays:
    """
    Return ``rays``, (..., N), as a camera with the true matrix has them: along A p.

    Their noise grows as the square root of a small solid angle, det A / |A p|^3.
    """
    ratio, shift = np.asarray(ratio)[..., None], np.asarray(shift)[..., None]
    x_a, y_a, z_a, x_d, y_d, z_d, noise_a, noise_d = rays
    x_a, y_a = ratio * x_a + shift * z_a, ratio * y_a
    x_d, y_d = ratio * x_d + shift * z_d, ratio * y_d
    long_a = np.sqrt(x_a * x_a + y_a * y_a + z_a * z_a)
    long_d = np.sqrt(x_d * x_d + y_d * y_d + z_d * z_d)
    return Rays(
        *(x_a / long_a, y_a / long_a, z_a / long_a),
        *(x_d / long_d, y_d / long_d, z_d / long_d),
        noise_a * ratio * long_a**-1.5,
        noise_d * ratio * long_d**-1.5,
    )


def model(parameters: FloatArray) -> FloatArray:
    """Return A^T E A and its derivatives by ``parameters``, (..., 9), as rows: (..., 10, 9)."""
    *leading, _ = parameters.shape
    log_ratio, rest, slope = (parameters[..., k, None, None] for k in (RATIO, REST, SLOPE))
    ratio, shift = np.exp(packed(log_ratio)), rest + slope * log_ratio
    rows = np.zeros((*leading, 10, 9))
    rows[..., : RATIO + 1, :] = matrices(parameters[..., :RATIO])
    rows[..., RATIO + 1, :] = rows[..., 0, :] * POWERS
    rows[..., : RATIO + 2, :] *= ratio**POWERS
    square = rows.reshape(*leading, 10, 3, 3)
    scaled = square[..., : RATIO + 2, :, :]
    scaled[..., 2] += shift / ratio * scaled[..., 0]
    scaled[..., 2, :] += shift / ratio * scaled[..., 0, :]
    by_shift = square[..., REST + 1, :, :]
    by_shift[..., 2] = square[..., 0, :, 0]
    by_shift[..., 2, :] += square[..., 0, 0, :]
    by_shift /= ratio
    square[..., RATIO + 1, :, :] += (slope - shift) * by_shift
    return rows
