"""
Planar motion with a camera that is nearly upright: tilt, roll and floor jitter have priors.

Refined from the last bearings; where there are none, or none that fit, the geometry is searched.
A camera that may be mounted any way is most likely level, or as estimated before: hypotheses
by pairs of matches, which need the attitude nearly, come first. Those by OpenCV's USAC, which need
nothing, are accepted where the matches support them by more than chance.

USAC gives an essential matrix without any vertical. In a planar motion the vertical n of
the desired camera is across the baseline and is the axis of the rotation: n . t = 0, R n = n. What
a pair leaves open, as a pure translation does, the prior of the attitude closes.
"""

from collections.abc import Callable
from dataclasses import replace
from functools import partial
import math
from typing import NamedTuple, TypeAlias

import numpy as np

from visual_servo_epipolar.core.arrays import BoolArray, FloatArray, packed
from visual_servo_epipolar.core.errors import DegenerateGeometryError
from visual_servo_epipolar.core.geometry.cheirality import oriented
from visual_servo_epipolar.core.geometry.epipolar import Bearings, decomposed, MOTION_PARAMETERS
from visual_servo_epipolar.core.geometry.lens import CALIBRATED, Lens, REACH
from visual_servo_epipolar.core.geometry.motion import HALF_PI
from visual_servo_epipolar.core.geometry.rays import rotation_level_camera
from visual_servo_epipolar.core.geometry.rotation import fit_rotation, headings
from visual_servo_epipolar.core.tracking.robust_geometry import BEST, essential_matrices
from visual_servo_epipolar.core.twoview.estimator import Attitude, COLD_DEVIATION, Estimate, Prior
from visual_servo_epipolar.core.twoview.hypotheses import (
    ALTERNATIVE_COST,
    best_modes,
    choose_mode,
    Rays,
    rays_of,
    scores,
    SEPARATION,
    two_point_hypotheses,
    WORST,
)
from visual_servo_epipolar.core.twoview.planar_motion import (
    BOTH,
    exchanged_on_plane,
    in_front_of,
    levelled,
    matrices,
    PHI,
    plausible_matches,
    PSI,
    RATIO,
    ROLL,
    SLOPE,
    TILT,
    TILT_JUMP,
    with_lens,
)
from visual_servo_epipolar.core.twoview.refinement import Fit, Problem, refined

GOOD_COST = 1.8  # of a match, in squared deviations: noise, and outliers fewer than one in six
REFITS = 3  # without matches that lie behind a camera
POOR = 0.4  # part of the worst possible cost above which few matches agree
COLD = math.radians(0.3)  # above this deviation of the tilt, hypotheses are made for several tilts
GENERAL = math.radians(2.5)  # above it tilts to try would be too many
TILTS = np.linspace(-1.0, 1.0, 9)  # of those, in deviations of the prior
PAIRS = 60  # for each attitude that is tried
NO_JUMP = np.zeros(1)
JUMPS = np.array([-3.2, -1.6, 0.0, 1.6, 3.2])  # of tilt between the views, in jitters
STEP = 0.25  # between the focal lengths that are tried: of their logarithm
PLANARITY = 0.004  # how far a good one leaves n . t and R n - n from zero
ROUGHNESS = 6.0  # of hypotheses by USAC, or of a focal length beside the true one, in noises

Hypotheses: TypeAlias = Callable[[Rays], FloatArray]
Refine: TypeAlias = Callable[[Rays, Prior], Fit]


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

    Where ``prior.lens`` is not calibrated, what is wrong with the camera matrix still is estimated
    as well: nine parameters, and hypotheses for several focal lengths.

    Raises
    ------
    DegenerateGeometryError
        With fewer than five matches, or all of them on the horizon, or no baseline at all.

    """
    del rng
    rays = rays_of(current, desired, noise)
    matches = plausible_matches(rays, prior)
    return _from_last_bearings(rays, matches, prior) or _searched(rays, matches, prior)


def _from_last_bearings(rays: Rays, matches: BoolArray, prior: Prior) -> Estimate | None:
    """Return the estimate by the last bearings where they explain the plausible ``matches``."""
    count = int(matches.sum())
    if prior.bearings is None or count < MOTION_PARAMETERS:
        return None
    problem = Problem.of(rays, prior, matches)
    fit = refined(_at_last_bearings(problem, prior), problem, _widening(rays, prior))
    change = np.abs(fit.parameters[: PHI + 1] - prior.angles).max()
    if not (fit.costs <= GOOD_COST * count and change < prior.deviation):
        return None
    return _concluded(rays, matches, fit, prior)


def _at_last_bearings(problem: Problem, prior: Prior) -> FloatArray:
    """Return parameters, shape (P,), as they are known before but at the last psi and phi."""
    start = problem.prior.mean.copy()
    start[: PHI + 1] = prior.angles
    return start


def _widening(rays: Rays, prior: Prior) -> float:
    """Return how much larger than the noise residuals are before jumps are estimated."""
    return float(np.maximum(1.0, prior.attitude.blur / rays.mean_noise))


def _concluded(rays: Rays, matches: BoolArray, fit: Fit, prior: Prior) -> Estimate:
    """
    Return the estimate by a ``fit`` to ``matches``, (N,), refined without those behind a camera.

    They agree by chance; an epipole that lies on one of them is fixed by nothing else.
    """
    for left in range(REFITS, -1, -1):
        agree = matches & (fit.squared <= WORST)
        estimate = _estimate(rays, agree, fit, prior)
        behind = agree & ~estimate.inliers
        if not left or not behind.any():
            break
        matches = matches & ~behind
        fit = refined(fit.parameters, Problem.of(rays, prior, matches))
    return estimate


def _estimate(rays: Rays, agree: BoolArray, fit: Fit, prior: Prior) -> Estimate:
    """Return the estimate by a ``fit`` and the matches that ``agree``, (N,), with its lens."""
    covariance, lens, of_lens = fit.covariance(), CALIBRATED, None
    variances = covariance.diagonal()
    if not 0.0 < variances.min() <= variances[: PHI + 1].max() < 1.0:  # rad: nothing is known then
        raise undetermined()
    parameters = _drawn(fit.parameters, covariance, prior)
    bearings, attitudes = covariance[: PHI + 1, : PHI + 1], covariance[BOTH, BOTH]
    if not prior.lens.calibrated:
        log_ratio, rest, slope = parameters[RATIO:].tolist()
        to_lens = np.array([[1.0, 0.0], [slope, 1.0]])  # the shift is the rest and k log r
        covariance_of_lens = to_lens @ covariance[RATIO:SLOPE, RATIO:SLOPE] @ to_lens.T
        lens = Lens.of(log_ratio, rest + slope * log_ratio, covariance_of_lens)
        rays = with_lens(rays, lens)
        # What not knowing the lens adds to the covariance of bearings is kept apart.
        bearings = np.asarray(np.linalg.inv(fit.information[:RATIO, :RATIO]))[: PHI + 1, : PHI + 1]
        of_lens = covariance[: PHI + 1, : PHI + 1] - bearings
    vote, inliers = in_front_of(rays, agree, parameters[:RATIO])
    balance = float(vote)
    psi, phi, tilt, tilt_jump, roll, roll_jump = parameters[:RATIO].tolist()
    sign = -1.0 if balance < 0.0 else 1.0
    return Estimate(
        oriented(psi, phi, balance),
        sign * matrices(parameters)[0].reshape(3, 3),
        inliers,
        min(abs(balance), 1.0),
        bearings,
        attitude=Attitude(tilt, roll, jitter=prior.attitude.jitter).known_to(attitudes),
        jump=math.hypot(tilt_jump, roll_jump),
        lens=lens,
        lens_covariance=of_lens,
    )


def _drawn(parameters: FloatArray, covariance: FloatArray, prior: Prior) -> FloatArray:
    """
    Return ``parameters`` drawn to the last bearings by as much as the matches leave open.

    Where they fix the bearings this changes nothing, where a plane nearly hides them it helps.
    """
    if prior.bearings is None:
        return parameters
    change = np.remainder(prior.angles - parameters[: PHI + 1] + HALF_PI, np.pi) - HALF_PI
    # (covariance + deviation^2 I)^-1 change, by the adjugate
    own = covariance.diagonal()[: PHI + 1] + prior.deviation * prior.deviation
    both = covariance[0, 1]
    pull = own[::-1] * change - both * change[::-1]
    pull /= own[0] * own[1] - both * both
    return np.asarray(parameters + (covariance[:, : PHI + 1] @ pull[:, None])[:, 0])


def undetermined() -> DegenerateGeometryError:
    """Return what is raised where the matches leave a bearing open altogether."""
    return DegenerateGeometryError(
        'the matches leave the bearings open: there is no baseline, or all of them lie on the '
        "horizon or on one line; track features above and below the camera's height"
    )


class _Found(NamedTuple):
    """The best fit to all N matches, those it was made of, its ``cost``, what else fits."""

    fit: Fit
    matches: BoolArray
    prior: Prior
    cost: float
    alternative: Bearings | None


def _searched(rays: Rays, matches: BoolArray, prior: Prior) -> Estimate:
    """Return the best estimate of one pair of views by the plausible ``matches``, (N,)."""
    found = _best_found(rays, matches, prior)
    estimate = _concluded(rays, found.matches, found.fit, found.prior)
    return replace(estimate, alternative=found.alternative)


def _best_found(rays: Rays, matches: BoolArray, prior: Prior) -> _Found:
    mount = prior.mount or prior.attitude
    anyhow = replace(prior, attitude=mount, bearings=None)
    everyone = np.ones_like(matches)
    try:
        found = _found(rays, matches, _likely(prior), _by_pairs)
    except DegenerateGeometryError:
        if not is_general(mount):
            raise
        return _found(rays, everyone, anyhow, _by_essentials)
    is_poor = found.cost > POOR * WORST * rays.matches
    if not (is_general(mount) and (is_cold(prior.attitude) or is_poor)):
        return found
    try:
        other = _found(rays, everyone, anyhow, _by_essentials)
    except DegenerateGeometryError:
        return found
    return other if other.cost < found.cost - ALTERNATIVE_COST else found


def _likely(prior: Prior) -> Prior:
    """Return the ``prior`` with its attitude near the mean, if a mount may be any."""
    attitude = prior.attitude
    if not is_general(attitude):
        return prior
    nearer = replace(
        attitude,
        tilt_deviation=min(attitude.tilt_deviation, COLD_DEVIATION),
        roll_deviation=min(attitude.roll_deviation, COLD_DEVIATION),
    )
    return replace(prior, attitude=nearer)


def _found(rays: Rays, matches: BoolArray, prior: Prior, refine: Refine) -> _Found:
    """Return what ``refine`` makes of those ``matches``, (N,), that are plausible."""
    matches = matches & plausible_matches(rays, prior)
    remaining = rays.take(matches)
    if remaining.matches < MOTION_PARAMETERS:
        raise DegenerateGeometryError(
            f'bearings need {MOTION_PARAMETERS} matches on one side of the horizon in both views, '
            f'got {remaining.matches} of {rays.matches}; track more features'
        )
    fits = refine(remaining, prior)
    mode, alternative = choose_mode(fits.parameters[:, : PHI + 1], fits.costs, prior)
    best = fits.take(mode)
    if alternative is None and not prior.decided and prior.lens.calibrated:
        alternative = _twin(remaining, best, prior)
    cost = float(best.costs) + WORST * (rays.matches - remaining.matches)
    return _Found(best.of_all(matches), matches, prior, cost, alternative)


def _twin(rays: Rays, fit: Fit, prior: Prior) -> Bearings | None:
    """Return the other geometry that a plane fits, where hypotheses have missed it; or None."""
    start = exchanged_on_plane(rays.take(fit.squared <= WORST), fit.parameters)
    if start is None:
        return None
    twin = refined(start, Problem.of(rays, prior), _widening(rays, prior))
    # Of one plane both have the same residuals, across two directions: sums of N squares.
    by_chance = 3.0 * math.sqrt(4.0 * rays.matches)
    if not twin.costs < fit.costs + max(ALTERNATIVE_COST, by_chance):
        return None
    psi, phi = twin.parameters[: PHI + 1].tolist()
    apart = np.abs(np.sin(twin.parameters[: PHI + 1] - fit.parameters[: PHI + 1])).max()
    return Bearings(psi, phi) if apart > math.sin(SEPARATION) else None


def _by_pairs(rays: Rays, prior: Prior) -> Fit:
    """Return the refined best modes of two-point hypotheses, and of the last bearings."""
    cold = is_cold(prior.attitude)
    with_jumps = partial(start_parameters, attitude=prior.attitude, jumps=JUMPS)
    first = partial(with_jumps, jumps=NO_JUMP) if cold else with_jumps
    fits = _refined_hypotheses(rays, prior, first)
    # A jump of the tilt may be more than hypotheses bear.
    is_poor = fits.costs.min() > POOR * WORST * rays.matches
    return _refined_hypotheses(rays, prior, with_jumps) if cold and is_poor else fits


def _by_essentials(rays: Rays, prior: Prior) -> Fit:
    """Return the refined best modes of hypotheses by USAC."""
    hypotheses = partial(general_start_parameters, attitude=prior.attitude)
    return _refined_hypotheses(rays, prior, hypotheses, roughness=ROUGHNESS)


def _refined_hypotheses(
    rays: Rays, prior: Prior, hypotheses: Hypotheses, roughness: float = 0.0
) -> Fit:
    """Return the refined best modes of ``hypotheses``, by the lens or by several focal lengths."""
    problem = Problem.of(rays, prior)
    calibrated = prior.lens.calibrated
    starts = hypotheses(rays) if calibrated else _by_focal_lengths(rays, prior, hypotheses)
    if prior.bearings is not None:
        starts = np.vstack([starts, _at_last_bearings(problem, prior)])
    if not len(starts):
        raise undetermined()
    least = roughness if calibrated else ROUGHNESS
    fits = refined(starts, problem, max(least, _widening(rays, prior)))
    if not calibrated:
        return fits
    # A match that agrees from behind a camera costs as much as one that does not.
    agree = fits.squared <= WORST
    _, in_front = in_front_of(rays, agree, fits.parameters)
    dear = np.where(agree & ~in_front, WORST - fits.squared, 0.0).sum(axis=-1)
    return fits._replace(costs=fits.costs + dear)


def _by_focal_lengths(rays: Rays, prior: Prior, hypotheses: Hypotheses) -> FloatArray:
    """Return all that ``hypotheses`` find by several focal lengths as parameters, (K, 9)."""
    steps = math.ceil(REACH * prior.lens.ratio_deviation / STEP)
    slope, starts = prior.lens.shift_slope, []
    for log_ratio in (STEP * np.arange(-steps, steps + 1)).tolist():
        planar = hypotheses(with_lens(rays, Lens(log_ratio, slope * log_ratio)))
        starts.append(np.hstack([planar, np.tile([log_ratio, 0.0, slope], (len(planar), 1))]))
    return np.vstack(starts)


def is_cold(attitude: Attitude) -> bool:
    """Return whether the tilt is so little known that several must be tried."""
    return attitude.tilt_deviation > COLD


def is_general(attitude: Attitude) -> bool:
    """Return whether the attitude is so little known that hypotheses must do without."""
    return max(attitude.tilt_deviation, attitude.roll_deviation) > GENERAL


def start_parameters(rays: Rays, attitude: Attitude, jumps: FloatArray) -> FloatArray:
    """
    Return the best hypotheses of different modes as parameters, shape (K, 6).

    ``jumps`` of the tilt between the views are tried, in jitters, and tilts where it is cold.
    """
    tilts = attitude.tilt + (attitude.tilt_deviation * TILTS if is_cold(attitude) else np.zeros(1))
    grid = np.stack(np.meshgrid(tilts, attitude.jitter * jumps), axis=-1).reshape(-1, 2)
    upright = levelled(rays, grid[:, 0], attitude.roll, tilt_jump=grid[:, 1])
    hypotheses = two_point_hypotheses(upright, PAIRS)
    costs = scores(hypotheses, upright.blurred(attitude.blur)).ravel()
    angles = np.angle(hypotheses).swapaxes(-2, -1).reshape(-1, 2)
    best = best_modes(angles, costs, BEST, separation=0.5 * SEPARATION)
    start = np.zeros((len(best), RATIO))
    start[:, [PSI, PHI]], start[:, ROLL] = angles[best], attitude.roll
    start[:, [TILT, TILT_JUMP]] = grid[best // hypotheses.shape[-1]]
    return start


def general_start_parameters(rays: Rays, attitude: Attitude) -> FloatArray:
    """Return hypotheses by USAC as parameters, shape (K, 6), none where it finds none."""
    # What both cameras see is turned to lie ahead of both: OpenCV has no rays.
    turn = fit_rotation(rays.current, rays.desired).rotation
    pixel = 0.5 * ROUGHNESS * float(rays.mean_noise)
    essential = essential_matrices(rays.current @ turn.T, rays.desired, pixel) @ turn
    return planar_parameters(essential, attitude) if len(essential) else np.empty((0, 6))


def planar_parameters(essential: FloatArray, attitude: Attitude) -> FloatArray:
    """Return the planar motions nearest to ``essential``, (K, 3, 3), without jumps: (K, 6)."""
    baseline, both = decomposed(essential)
    away = both - np.eye(3)
    spread = baseline[:, :, None] * baseline[:, None] + away.swapaxes(-1, -2) @ away
    # The prior of attitude is a quadratic form of the vertical.
    right, down, forward = rotation_level_camera(attitude.tilt, attitude.roll)
    prior = np.outer(right, right) / attitude.roll_deviation**2
    prior += np.outer(forward, forward) / attitude.tilt_deviation**2
    values, vectors = np.linalg.eigh(spread / PLANARITY**2 + prior)
    # One of the two is the other turned by half around the baseline: no vertical is its axis.
    twin = values[..., 0].argmin(axis=0)
    each = np.arange(len(essential))
    vertical, rotation = vectors[twin, each, :, 0], both[twin, each]
    vertical *= np.copysign(1.0, vertical @ down)[:, None]
    tilt = np.arcsin(np.clip(vertical[:, 2], -1.0, 1.0))
    roll = np.arctan2(packed(vertical[:, 0]), packed(vertical[:, 1]))
    level = rotation_level_camera(tilt, roll)
    upright = (level @ baseline[..., None])[..., 0]
    turn = level @ rotation @ level.swapaxes(-1, -2)
    start = np.zeros((len(tilt), 6))
    start[:, PSI] = np.arctan2(packed(upright[:, 2]), packed(upright[:, 0]))
    start[:, PHI] = start[:, PSI] - headings(turn) - HALF_PI
    start[:, TILT], start[:, ROLL] = tilt, roll
    return start
