"""Planar motion with a camera that is nearly upright: tilt, roll and floor jitter have priors."""

from functools import partial
import math

import numpy as np

from visual_servo_epipolar.core.arrays import BoolArray, FloatArray
from visual_servo_epipolar.core.estimators.base import Attitude, Estimate, Prior
from visual_servo_epipolar.core.estimators.machinery.attitude_prior import (
    attitude_prior,
    JITTER_SHARE,
    levelled,
    plausible_matches,
)
from visual_servo_epipolar.core.estimators.machinery.conclusion import (
    balances_in_front,
    Conclusion,
    estimate_in_front,
)
from visual_servo_epipolar.core.estimators.machinery.gaussian import Posterior, posterior
from visual_servo_epipolar.core.estimators.machinery.hypotheses import (
    INLIER_DEVIATIONS,
    plausible,
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
    ROUGHNESS,
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
    cameras,
    matrices,
    phasors_of,
    PHI,
    PSI,
    ROLL,
    ROLL_JUMP,
    TILT,
    TILT_JUMP,
)
from visual_servo_epipolar.core.geometry.cheirality import oriented
from visual_servo_epipolar.core.geometry.epipolar import Bearings, fundamentals

MIN_MATCHES = 5
BOTH = slice(TILT, ROLL + 1, ROLL - TILT)  # tilt and roll


def soft_planar(
    current: FloatArray,
    desired: FloatArray,
    *,
    noise: FloatArray | float,
    prior: Prior,
    rng: np.random.Generator,
) -> Estimate:
    """
    Estimate (psi, phi) together with tilt and roll, and what the floor changed of them since.

    Two-point hypotheses on levelled rays, the best of different modes refined by Gauss-Newton on
    six parameters with ``prior.attitude``, the lowest truncated cost wins. Where
    ``prior.bearings`` fit at once nothing else is looked for. A camera whose attitude is not known
    yet costs several tilts to try. ``rng`` is not needed.

    Raises
    ------
    DegenerateGeometryError
        With fewer than five matches, or all of them on the horizon, or no baseline at all.

    """
    del rng
    rays = rays_of(current, desired, noise)
    matches = plausible_matches(rays, prior.attitude)
    count = int(matches.sum())
    if prior.bearings is not None and count >= MIN_MATCHES:
        tilt, roll = prior.attitude.tilt, prior.attitude.roll
        start = np.array([prior.bearings.psi, prior.bearings.phi, tilt, 0.0, roll, 0.0])
        scale = float(widening(prior.attitude.jitter, rays))
        fit = _refined(rays, matches, start, scale, prior=prior)
        if is_consistent(fit, prior.angles, prior.deviation, count):
            return _estimate(rays, matches, fit, prior)
    return search(rays, matches, prior)


def search(rays: Rays, matches: BoolArray, prior: Prior) -> Estimate:
    """Estimate from hypotheses by the plausible ``matches``, shape (N,)."""
    return searched(rays, matches, prior, SEARCH)


def _by_pairs(rays: Rays, prior: Prior) -> Fit:
    """Return the refined best modes of two-point hypotheses, and of the last bearings."""
    cold = is_cold(prior.attitude)
    fits = _pairs_with(NO_JUMP if cold else JUMPS, rays, prior)
    return _pairs_with(JUMPS, rays, prior) if cold and is_poor(fits) else fits


def _pairs_with(jumps: FloatArray, rays: Rays, prior: Prior) -> Fit:
    starts = start_parameters(rays, prior.attitude, jumps)
    if prior.bearings is not None:
        mean = attitude_prior(prior.attitude).mean
        starts = np.vstack([starts, with_bearings(mean, prior.angles)])
    return _refined_modes(starts, rays, prior)


def _by_fives(rays: Rays, prior: Prior) -> Fit:
    """Return the refined best modes of five-point hypotheses."""
    starts = general_start_parameters(rays, prior.attitude)
    return _refined_modes(starts, rays, prior, least_scale=ROUGHNESS)


def _refined_modes(
    starts: FloatArray, rays: Rays, prior: Prior, *, least_scale: float = 0.0
) -> Fit:
    fits = refined_modes(
        starts,
        problem_of(matrices, table_of(rays), attitude_prior(prior.attitude)),
        negligible=float(NEGLIGIBLE * rays.mean_noise),
        scale=max(least_scale, float(widening(prior.attitude.jitter, rays))),
    )
    agree = fits.squared <= INLIER_DEVIATIONS**2
    _, in_front = in_front_of(rays, agree, fits.parameters)
    dear = np.where(agree & ~in_front, INLIER_DEVIATIONS**2 - fits.squared, 0.0).sum(axis=-1)
    return fits._replace(costs=fits.costs + dear)


def with_bearings(mean: FloatArray, angles: FloatArray) -> FloatArray:
    """Return parameters, shape (..., P), at the ``mean`` of their prior but at psi and phi."""
    start = mean.copy()
    start[..., [PSI, PHI]] = angles
    return start


def widening(jitter: FloatArray | float, rays: Rays) -> FloatArray:
    """Return how much larger than the noise residuals are before jumps are estimated, (...)."""
    return np.maximum(1.0, JITTER_SHARE * jitter / rays.mean_noise)


def _estimate(
    rays: Rays,
    matches: BoolArray,
    fit: Fit,
    prior: Prior,
    alternative: Bearings | None = None,
) -> Estimate:
    def concluded(matches: BoolArray, fit: Fit) -> Estimate:
        after = posterior(fit.parameters, fit.covariance(), prior.angles, prior.deviation)
        agree = matches & (fit.squared <= INLIER_DEVIATIONS**2)
        return estimate_of(conclude(rays, agree, after), prior, alternative)

    return estimate_in_front(matches, fit, concluded, partial(_refined, rays, prior=prior))


def _refined(
    rays: Rays, matches: BoolArray, start: FloatArray, scale: float = 1.0, *, prior: Prior
) -> Fit:
    """Return the fit to ``matches``, (N,), from a ``start``, the noise ``scale`` times wider."""
    return refined(
        start,
        problem_of(matrices, table_of(rays, matches), attitude_prior(prior.attitude)),
        negligible=float(NEGLIGIBLE * rays.mean_noise),
        scale=scale,
    )


def conclude(rays: Rays, agree: BoolArray, after: Posterior) -> Conclusion:
    """Return the oriented geometry, shape (...), of matches that ``agree``, (..., N)."""
    phasors = phasors_of(after.parameters)
    bearings, both = phasors[..., : PHI + 1], cameras(phasors)
    balance, inliers = in_front_of(rays, agree, after.parameters)
    planar = fundamentals(bearings, balance)
    fundamental = both[..., 0, :, :].swapaxes(-2, -1) @ planar @ both[..., 1, :, :]
    return Conclusion(*after, inliers, balance, fundamental)


def in_front_of(rays: Rays, agree: BoolArray, angles: FloatArray) -> tuple[FloatArray, BoolArray]:
    """Return the vote of matches in front of the cameras, (...), and which they are, (..., N)."""
    upright = levelled(
        rays, angles[..., TILT], angles[..., ROLL], angles[..., TILT_JUMP], angles[..., ROLL_JUMP]
    )
    inliers = agree & plausible(upright, INLIER_DEVIATIONS * rays.noise)
    return balances_in_front(np.exp(1j * angles[..., : PHI + 1]), upright, inliers)


def estimate_of(
    conclusion: Conclusion, prior: Prior, alternative: Bearings | None = None
) -> Estimate:
    """Return what is concluded of one pair of views as an estimate, if it is determined."""
    conclusion.require_determined()
    psi, phi, tilt, tilt_jump, roll, roll_jump = conclusion.parameters.tolist()
    attitude = Attitude(tilt, roll, jitter=prior.attitude.jitter)
    balance = float(conclusion.balance)
    return Estimate(
        oriented(psi, phi, balance),
        conclusion.fundamental,
        conclusion.inliers,
        min(abs(balance), 1.0),
        conclusion.covariance[: PHI + 1, : PHI + 1],
        attitude=attitude.known_to(conclusion.covariance[BOTH, BOTH]),
        alternative=alternative,
        jump=math.hypot(tilt_jump, roll_jump),
    )


SEARCH = SearchMethod(MIN_MATCHES, _by_pairs, _by_fives, _estimate)
