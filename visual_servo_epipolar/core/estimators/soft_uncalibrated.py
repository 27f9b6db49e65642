"""
The soft planar estimator for a camera that nobody calibrated: focal length and principal point.

How a wrong camera matrix changes E is in ``machinery.wrong_lens``.
"""

from collections.abc import Callable
from dataclasses import replace
from functools import partial
import math
from typing import NamedTuple

import numpy as np

from visual_servo_epipolar.core.arrays import BoolArray, FloatArray, packed
from visual_servo_epipolar.core.estimators.base import Estimate, Prior
from visual_servo_epipolar.core.estimators.machinery.attitude_prior import (
    plausible_matches,
)
from visual_servo_epipolar.core.estimators.machinery.conclusion import (
    Conclusion,
    estimate_in_front,
)
from visual_servo_epipolar.core.estimators.machinery.gaussian import (
    Posterior,
    posterior,
)
from visual_servo_epipolar.core.estimators.machinery.hypotheses import (
    INLIER_DEVIATIONS,
    Rays,
    rays_of,
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
from visual_servo_epipolar.core.estimators.machinery.search.general_hypotheses import (
    general_start_parameters,
)
from visual_servo_epipolar.core.estimators.machinery.search.search import searched, SearchMethod
from visual_servo_epipolar.core.estimators.machinery.search.tilted_hypotheses import (
    is_cold,
    is_poor,
    JUMPS,
    NO_JUMP,
    start_parameters,
)
from visual_servo_epipolar.core.estimators.machinery.tilted_planar import (
    PHI,
)
from visual_servo_epipolar.core.estimators.machinery.wrong_lens import (
    corrected,
    lens_prior,
    model,
    RATIO,
    REACH,
    REST,
    SLOPE,
    stretch,
)
from visual_servo_epipolar.core.estimators.soft_planar import (
    BOTH,
    MIN_MATCHES,
    widening,
    with_bearings,
)
from visual_servo_epipolar.core.estimators.soft_planar import (
    conclude as conclude_calibrated,
)
from visual_servo_epipolar.core.estimators.soft_planar import (
    estimate_of as calibrated_estimate_of,
)
from visual_servo_epipolar.core.geometry.epipolar import Bearings
from visual_servo_epipolar.core.geometry.lens import for_wrong_rays, Lens
from visual_servo_epipolar.core.geometry.rays import image_axes

STEP = 0.25  # between the focal lengths that are tried: of their logarithm
ROUGHNESS = 3.0  # of hypotheses with a focal length between two that are tried, in noises


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
        start = with_bearings(before.mean, prior.angles)
        scale = float(widening(prior.attitude.jitter, rays))
        fit = _refined(rays, matches, start, scale, prior=prior)
        if is_consistent(fit, prior.angles, prior.deviation, count):
            return _estimate(rays, matches, fit, prior)
    return search(rays, matches, prior)


def search(rays: Rays, matches: BoolArray, prior: Prior) -> Estimate:
    """Estimate from hypotheses by the plausible ``matches``, shape (N,)."""
    return searched(rays, matches, prior, SEARCH)


def _by_pairs(rays: Rays, prior: Prior) -> Fit:
    """Return the refined best modes of two-point hypotheses by several focal lengths."""
    cold = is_cold(prior.attitude)
    fits = _pairs_with(NO_JUMP if cold else JUMPS, rays, prior)
    return _pairs_with(JUMPS, rays, prior) if cold and is_poor(fits) else fits


def _pairs_with(jumps: FloatArray, rays: Rays, prior: Prior) -> Fit:
    return _refined_hypotheses(
        rays, prior, lambda right: start_parameters(right, prior.attitude, jumps)
    )


def _by_fives(rays: Rays, prior: Prior) -> Fit:
    """Return the refined best modes of five-point hypotheses by several focal lengths."""
    return _refined_hypotheses(
        rays, prior, lambda right: general_start_parameters(right, prior.attitude)
    )


def _refined_hypotheses(rays: Rays, prior: Prior, planar: Callable[[Rays], FloatArray]) -> Fit:
    """Return the refined best modes of what ``planar`` finds by several focal lengths."""
    before = lens_prior(prior.attitude, np.array(prior.lens.known))
    steps = math.ceil(REACH * prior.lens.ratio_deviation / STEP)
    starts = [_start_parameters(rays, prior, planar, STEP * k) for k in range(-steps, steps + 1)]
    if prior.bearings is not None:
        starts.append(with_bearings(before.mean, prior.angles)[None])
    return refined_modes(
        np.vstack(starts),
        problem_of(model, table_of(rays, axes=image_axes), before),
        negligible=float(NEGLIGIBLE * rays.mean_noise),
        scale=max(ROUGHNESS, float(widening(prior.attitude.jitter, rays))),
    )


def _start_parameters(
    rays: Rays, prior: Prior, planar: Callable[[Rays], FloatArray], log_ratio: float
) -> FloatArray:
    """Return the best hypotheses by one focal length as parameters, shape (K, 9)."""
    ratio, slope = math.exp(log_ratio), prior.lens.shift_slope
    starts = planar(corrected(rays, ratio, slope * log_ratio))
    return np.hstack([starts, np.tile([log_ratio, 0.0, slope], (len(starts), 1))])


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


def _estimate(
    rays: Rays,
    matches: BoolArray,
    fit: Fit,
    prior: Prior,
    alternative: Bearings | None = None,
) -> Estimate:
    def concluded(matches: BoolArray, fit: Fit) -> Estimate:
        after = posterior(fit.parameters, fit.covariance(), prior.angles, prior.deviation)
        return estimate_of(conclude(rays, matches, fit, after), prior, alternative)

    return estimate_in_front(matches, fit, concluded, partial(_refined, rays, prior=prior))


def _refined(
    rays: Rays, matches: BoolArray, start: FloatArray, scale: float = 1.0, *, prior: Prior
) -> Fit:
    """Return the fit to ``matches``, (N,), from a ``start``, the noise ``scale`` times wider."""
    before = lens_prior(prior.attitude, np.array(prior.lens.known))
    return refined(
        start,
        problem_of(model, table_of(rays, matches, image_axes), before),
        negligible=float(NEGLIGIBLE * rays.mean_noise),
        scale=scale,
    )


def conclude(rays: Rays, matches: BoolArray, fit: Fit, after: Posterior) -> LensConclusion:
    """Return the oriented geometry and the lens of pairs of views, (...), from refined ``fit``."""
    log_ratio, rest, slope = (after.parameters[..., k] for k in (RATIO, REST, SLOPE))
    ratio, shift = np.exp(packed(log_ratio)), rest + slope * log_ratio
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
        attitude=attitude.known_to(attitude.covariance + spare[BOTH, BOTH]),
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


SEARCH = SearchMethod(MIN_MATCHES, _by_pairs, _by_fives, _estimate, stretch)
