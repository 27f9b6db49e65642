"""
The soft planar estimator for a camera that nobody calibrated: focal length and principal point.

Rays made with a wrong camera matrix are along A^-1 p, A = [[r, 0, h], [0, r, 0], [0, 0, 1]], with
r the focal length that was told over the true one, and h the shift of the principal point along u.
That along v acts as a tilt. So E becomes A^T E A: with D = diag(r, r, 1) and B = D^-1 A, each
element by r to the power of 2, 1 or 0, then h / r times the first row and column to the last ones.
"""

from dataclasses import replace
import math
from typing import NamedTuple

import numpy as np

from visual_servo_epipolar.core.arrays import BoolArray, FloatArray
from visual_servo_epipolar.core.estimators.base import Estimate, Prior
from visual_servo_epipolar.core.estimators.machinery.attitude_prior import (
    AnyAttitude,
    attitude_prior,
    plausible_matches,
)
from visual_servo_epipolar.core.estimators.machinery.conclusion import Conclusion
from visual_servo_epipolar.core.estimators.machinery.gaussian import (
    GaussianPrior,
    Posterior,
    posterior,
)
from visual_servo_epipolar.core.estimators.machinery.hypotheses import (
    choose_mode,
    INLIER_DEVIATIONS,
    Rays,
    rays_of,
    too_few,
)
from visual_servo_epipolar.core.estimators.machinery.refinement import (
    Fit,
    is_consistent,
    NEGLIGIBLE,
    problem_of,
    refined,
    refined_modes,
)
from visual_servo_epipolar.core.estimators.machinery.sampson import table_of
from visual_servo_epipolar.core.estimators.machinery.tilted_hypotheses import (
    is_cold,
    is_poor,
    JUMPS,
    NO_JUMP,
    start_parameters,
)
from visual_servo_epipolar.core.estimators.machinery.tilted_planar import (
    matrices,
    PHI,
    ROLL,
    TILT,
)
from visual_servo_epipolar.core.estimators.soft_planar import (
    conclude as conclude_calibrated,
)
from visual_servo_epipolar.core.estimators.soft_planar import (
    estimate_of as calibrated_estimate_of,
)
from visual_servo_epipolar.core.estimators.soft_planar import (
    MIN_MATCHES,
    widening,
    with_bearings,
)
from visual_servo_epipolar.core.geometry.epipolar import Bearings
from visual_servo_epipolar.core.geometry.lens import for_wrong_rays, Lens
from visual_servo_epipolar.core.geometry.rays import image_axes

# Places among the parameters: log r, the rest of h, and k, which is known: h = rest + k log r. The
# prior of log r and h is correlated, that of log r and the rest is not.
RATIO, REST, SLOPE = 6, 7, 8
KNOWN = 1e12  # information of what does not move
POWERS = np.array([2.0, 2.0, 1.0, 2.0, 2.0, 1.0, 1.0, 1.0, 0.0])  # of r, by rows
STEP = 0.25  # between the focal lengths that are tried: of their logarithm
ROUGHNESS = 3.0  # of hypotheses with a focal length between two that are tried, in noises
REACH = 2.0  # how far they reach, in deviations of the prior


def soft_uncalibrated(
    current: FloatArray,
    desired: FloatArray,
    *,
    noise: FloatArray | float,
    prior: Prior,
    rng: np.random.Generator,
) -> Estimate:
    """
    Estimate (psi, phi), tilt, roll and their jumps together with the camera matrix.

    Rays come as ``prior.lens`` has corrected them, and its deviations are the prior of what is
    wrong with them still. Hypotheses are made for several focal lengths; where ``prior.bearings``
    fit at once, nothing else is looked for. ``rng`` is not needed.

    Raises
    ------
    DegenerateGeometryError
        With fewer than five matches, or all of them on the horizon, or no baseline at all.

    """
    del rng
    rays = rays_of(current, desired, noise)
    matches = plausible_matches(rays, prior.attitude, stretch(prior))
    count = int(matches.sum())
    if prior.bearings is not None and count >= MIN_MATCHES:
        before = lens_prior(prior.attitude, np.array(prior.lens.known))
        fit = refined(
            with_bearings(before.mean, prior.angles),
            problem_of(model, table_of(rays, matches, image_axes), before),
            negligible=float(NEGLIGIBLE * rays.mean_noise),
            scale=float(widening(prior.attitude.jitter, rays)),
        )
        if is_consistent(fit, prior.angles, prior.deviation, count):
            return _estimate(rays, matches, fit, prior)
    return search(rays, matches, prior)


def search(rays: Rays, matches: BoolArray, prior: Prior) -> Estimate:
    """Estimate from hypotheses by pairs of the plausible ``matches``, shape (N,)."""
    remaining = rays.take(matches)
    if remaining.matches < MIN_MATCHES:
        raise too_few(remaining.matches, rays.matches, MIN_MATCHES)
    cold = is_cold(prior.attitude)
    fits = _refined_hypotheses(remaining, prior, NO_JUMP if cold else JUMPS)
    if cold and is_poor(fits):
        fits = _refined_hypotheses(remaining, prior, JUMPS)
    mode, alternative = choose_mode(fits.parameters[:, : PHI + 1], fits.costs, prior)
    fit = fits.take(mode).of_all(matches)
    return _estimate(rays, matches, fit, prior, alternative)


def _refined_hypotheses(rays: Rays, prior: Prior, jumps: FloatArray) -> Fit:
    """Return the refined best modes of hypotheses by several focal lengths."""
    before = lens_prior(prior.attitude, np.array(prior.lens.known))
    steps = math.ceil(REACH * prior.lens.ratio_deviation / STEP)
    starts = [_start_parameters(rays, prior, jumps, STEP * k) for k in range(-steps, steps + 1)]
    if prior.bearings is not None:
        starts.append(with_bearings(before.mean, prior.angles)[None])
    return refined_modes(
        np.vstack(starts),
        problem_of(model, table_of(rays, axes=image_axes), before),
        negligible=float(NEGLIGIBLE * rays.mean_noise),
        scale=max(ROUGHNESS, float(widening(prior.attitude.jitter, rays))),
    )


def _start_parameters(rays: Rays, prior: Prior, jumps: FloatArray, log_ratio: float) -> FloatArray:
    """Return the best hypotheses by one focal length as parameters, shape (K, 9)."""
    ratio, slope = math.exp(log_ratio), prior.lens.shift_slope
    right = corrected(rays, ratio, slope * log_ratio)
    planar = start_parameters(right, prior.attitude, jumps)
    return np.hstack([planar, np.tile([log_ratio, 0.0, slope], (len(planar), 1))])


def stretch(prior: Prior) -> float:
    """Return by how much true rays may be longer than those that came."""
    return float(np.exp(REACH * prior.lens.ratio_deviation))


def lens_prior(attitude: AnyAttitude, lens: FloatArray) -> GaussianPrior:
    """
    Return what is known of all nine parameters, shape (..., 9) each.

    ``lens``, shape (..., 3), are deviations of log r and of the rest of h, and k.
    """
    mean, information = attitude_prior(attitude)
    lens_mean, lens_information = np.zeros((2, *lens.shape))
    lens_mean[..., 2], lens_information[..., 2] = lens[..., 2], KNOWN
    lens_information[..., :2] = np.power(lens[..., :2], -2.0)
    return GaussianPrior(
        np.concatenate([mean, lens_mean], axis=-1),
        np.concatenate([information, lens_information], axis=-1),
    )


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
    ratio, shift = np.exp(log_ratio), rest + slope * log_ratio
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


class LensConclusion(NamedTuple):
    """
    Geometries of pairs of views, as of calibrated cameras, and what is found of the lens.

    Of log r, h and k, shape (...) each; ``covariance``, (..., 9, 9), is that of all parameters,
    ``calibrated`` has what it would be if the lens were known.
    """

    calibrated: Conclusion
    log_ratio: FloatArray
    shift: FloatArray
    slope: FloatArray
    covariance: FloatArray

    def take(self, row: int) -> 'LensConclusion':
        """Return one of many geometries."""
        calibrated, *lens = self
        return LensConclusion(calibrated.take(row), *(part[row] for part in lens))


def _estimate(
    rays: Rays,
    matches: BoolArray,
    fit: Fit,
    prior: Prior,
    alternative: Bearings | None = None,
) -> Estimate:
    after = posterior(fit.parameters, fit.covariance(), prior.angles, prior.deviation)
    conclusion = conclude(rays, matches, fit, after)
    return estimate_of(conclusion, prior, alternative)


def conclude(rays: Rays, matches: BoolArray, fit: Fit, after: Posterior) -> LensConclusion:
    """Return the oriented geometry and the lens of pairs of views, (...), from refined ``fit``."""
    log_ratio, rest, slope = (after.parameters[..., k] for k in (RATIO, REST, SLOPE))
    ratio, shift = np.exp(log_ratio), rest + slope * log_ratio
    with_lens_known = np.asarray(
        np.linalg.inv(fit.information[..., :RATIO, :RATIO]), dtype=np.float64
    )
    calibrated = conclude_calibrated(
        corrected(rays, ratio, shift),
        matches & (fit.squared <= INLIER_DEVIATIONS**2),
        Posterior(after.parameters[..., :RATIO], with_lens_known, after.determined),
    )
    return LensConclusion(calibrated, log_ratio, shift, slope, after.covariance)


def estimate_of(
    conclusion: LensConclusion, prior: Prior, alternative: Bearings | None = None
) -> Estimate:
    """Return what is concluded of one pair of views as an estimate, if it is determined."""
    calibrated = calibrated_estimate_of(conclusion.calibrated, prior, alternative)
    lens = _lens(conclusion)
    # What not knowing the lens adds to covariances.
    spare = conclusion.covariance[:RATIO, :RATIO] - conclusion.calibrated.covariance
    attitude = calibrated.attitude or prior.attitude
    return replace(
        calibrated,
        lens=lens,
        lens_covariance=spare[: PHI + 1, : PHI + 1],
        fundamental=for_wrong_rays(calibrated.fundamental, lens),
        attitude=replace(
            attitude,
            tilt_deviation=math.sqrt(attitude.tilt_deviation**2 + spare[TILT, TILT]),
            roll_deviation=math.sqrt(attitude.roll_deviation**2 + spare[ROLL, ROLL]),
        ),
    )


def _lens(conclusion: LensConclusion) -> Lens:
    """Return the lens found, with its part of the covariance of the parameters."""
    to_lens = np.array([[1.0, 0.0], [float(conclusion.slope), 1.0]])  # h is the rest and k log r
    covariance = conclusion.covariance[RATIO:SLOPE, RATIO:SLOPE]
    return Lens.of(
        float(conclusion.log_ratio),
        float(conclusion.shift),
        to_lens @ covariance @ to_lens.T,
    )
