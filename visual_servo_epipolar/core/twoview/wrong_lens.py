"""
Rays of a camera whose matrix is wrong, and E with its derivatives by these errors.

Rays made with a wrong camera matrix are along A^-1 p, A = [[r, 0, h], [0, r, 0], [0, 0, 1]], with
r the configured focal length over the true one, and h the shift of the principal point along u.
That along v acts as a tilt. So E becomes A^T E A: with D = diag(r, r, 1) and B = D^-1 A, each
element by r to the power of 2, 1 or 0, then h / r times the first row and column to the last ones.
"""

from collections.abc import Callable
from dataclasses import replace
import math

import numpy as np

from visual_servo_epipolar.core.arrays import BoolArray, FloatArray, packed
from visual_servo_epipolar.core.geometry.lens import corrected as lens_corrected
from visual_servo_epipolar.core.geometry.lens import for_wrong_rays, Lens
from visual_servo_epipolar.core.twoview import tilted_planar
from visual_servo_epipolar.core.twoview.estimator import Estimate, Prior
from visual_servo_epipolar.core.twoview.hypotheses import Rays, rays_of
from visual_servo_epipolar.core.twoview.planar import Posterior
from visual_servo_epipolar.core.twoview.refinement import GaussianPrior
from visual_servo_epipolar.core.twoview.tilted_planar import (
    attitude_prior,
    BOTH,
    PHI,
    REACH,
)

# Places among the parameters: log r, the rest of h, and k, which is known: h = rest + k log r. The
# prior of log r and h is correlated, that of log r and the rest is not.
RATIO, REST, SLOPE = 6, 7, 8
KNOWN = 1e12  # information of what does not move
POWERS = np.array([2.0, 2.0, 1.0, 2.0, 2.0, 1.0, 1.0, 1.0, 0.0])  # of r, by rows
STEP = 0.25  # between the focal lengths that are tried: of their logarithm


def lens_prior(prior: Prior) -> GaussianPrior:
    """Return what is known of all nine parameters."""
    before, lens = attitude_prior(prior), prior.lens
    mean, information = np.zeros(9), np.zeros((9, 9))
    mean[:RATIO], mean[SLOPE] = before.mean, lens.shift_slope
    information[:RATIO, :RATIO] = before.information
    information[RATIO, RATIO] = 1.0 / (lens.ratio_deviation * lens.ratio_deviation)
    information[REST, REST] = 1.0 / (lens.rest_deviation * lens.rest_deviation)
    information[SLOPE, SLOPE] = KNOWN
    return GaussianPrior(mean, information)


def starts_by_focal_lengths(
    rays: Rays, prior: Prior, hypotheses: Callable[[Rays], FloatArray]
) -> FloatArray:
    """Return all that ``hypotheses`` finds by several focal lengths as parameters, (K, 9)."""
    steps = math.ceil(REACH * prior.lens.ratio_deviation / STEP)
    slope, starts = prior.lens.shift_slope, []
    for k in range(-steps, steps + 1):
        log_ratio = STEP * k
        planar = hypotheses(corrected(rays, Lens(log_ratio, slope * log_ratio)))
        starts.append(np.hstack([planar, np.tile([log_ratio, 0.0, slope], (len(planar), 1))]))
    return np.vstack(starts)


def corrected(rays: Rays, lens: Lens) -> Rays:
    """Return ``rays``, (N,), as a camera with the true matrix has them."""
    (current, growth_a), (desired, growth_d) = (
        lens_corrected(each, lens) for each in (rays.current, rays.desired)
    )
    noise = np.stack([rays.noise_a * growth_a, rays.noise_d * growth_d], axis=-1)
    return rays_of(current, desired, noise)


def matrices(parameters: FloatArray) -> FloatArray:
    """Return A^T E A and its derivatives by ``parameters``, (..., 9), as rows: (..., 10, 9)."""
    *leading, _ = parameters.shape
    log_ratio, rest, slope = (parameters[..., k, None, None] for k in (RATIO, REST, SLOPE))
    ratio, shift = np.exp(packed(log_ratio)), rest + slope * log_ratio
    rows = np.zeros((*leading, 10, 9))
    rows[..., : RATIO + 1, :] = tilted_planar.matrices(parameters[..., :RATIO])
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


def conclude(rays: Rays, agree: BoolArray, after: Posterior, prior: Prior) -> Estimate:
    """Return the estimate by matches that ``agree``, (N,), with the lens that they show."""
    log_ratio, rest, slope = after.parameters[RATIO:].tolist()
    shift = rest + slope * log_ratio
    if_known = np.asarray(np.linalg.inv(after.information[:RATIO, :RATIO]), dtype=np.float64)
    known = Posterior(after.parameters[:RATIO], if_known, after.information[:RATIO, :RATIO])
    right = corrected(rays, Lens(log_ratio, shift))
    estimate = tilted_planar.conclude(right, agree, known, prior)
    to_lens = np.array([[1.0, 0.0], [slope, 1.0]])  # h is the rest and k log r
    lens_covariance = to_lens @ after.covariance[RATIO:SLOPE, RATIO:SLOPE] @ to_lens.T
    lens = Lens.of(log_ratio, shift, lens_covariance)
    # What not knowing the lens adds to covariances.
    spare = after.covariance[:RATIO, :RATIO] - if_known
    attitude = estimate.attitude or prior.attitude
    return replace(
        estimate,
        lens=lens,
        lens_covariance=spare[: PHI + 1, : PHI + 1],
        fundamental=for_wrong_rays(estimate.fundamental, lens),
        attitude=attitude.known_to(attitude.covariance + spare[BOTH, BOTH]),
    )
