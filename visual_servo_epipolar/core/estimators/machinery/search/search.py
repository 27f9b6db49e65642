"""
Search of the geometry of a pair of views where no bearings are known, or none that fit.

A camera that may be mounted any way is most likely level, or as estimated before: hypotheses
by pairs of matches, which need the attitude nearly, come first. Those by five matches, which need
nothing, are accepted where the matches support them by more than chance.
"""

from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import partial
import math

import numpy as np

from visual_servo_epipolar.core.arrays import BoolArray, FloatArray
from visual_servo_epipolar.core.errors import DegenerateGeometryError
from visual_servo_epipolar.core.estimators.base import COLD_DEVIATION, Estimate, Prior
from visual_servo_epipolar.core.estimators.machinery.hypotheses import (
    ALTERNATIVE_COST,
    choose_mode,
    INLIER_DEVIATIONS,
    Rays,
    remaining_rays,
    SEPARATION,
)
from visual_servo_epipolar.core.estimators.machinery.planar import (
    concluded,
    PlanarModel,
    with_bearings,
)
from visual_servo_epipolar.core.estimators.machinery.refinement import Fit, refined, refined_modes
from visual_servo_epipolar.core.estimators.machinery.search.general_hypotheses import (
    general_start_parameters,
    ROUGHNESS,
)
from visual_servo_epipolar.core.estimators.machinery.search.tilted_hypotheses import (
    is_cold,
    is_general,
    JUMPS,
    NO_JUMP,
    start_parameters,
)
from visual_servo_epipolar.core.estimators.machinery.tilted_planar import (
    exchanged_on_plane,
    in_front_of,
    PHI,
    plausible_matches,
)
from visual_servo_epipolar.core.estimators.machinery.wrong_lens import starts_by_focal_lengths
from visual_servo_epipolar.core.geometry.epipolar import Bearings

WORST = INLIER_DEVIATIONS**2  # cost of a match that does not agree
POOR = 0.4  # part of the worst possible cost above which few matches agree
ROUGH_LENS = 3.0  # of hypotheses with a focal length between two that are tried, in noises

Refine = Callable[[PlanarModel, Rays, Prior], Fit]


@dataclass(frozen=True, slots=True)
class _Found:
    """The best fit to all N matches, those it was made of, its ``cost``, what else fits."""

    fit: Fit
    matches: BoolArray
    prior: Prior
    cost: float
    alternative: Bearings | None


def search(model: PlanarModel, rays: Rays, matches: BoolArray, prior: Prior) -> Estimate:
    """
    Return the best estimate of one pair of views, of which the plausible ``matches`` are (N,).

    Raises
    ------
    DegenerateGeometryError
        With too few matches, or where they leave the geometry open.

    """
    found = _best_found(model, rays, matches, prior)
    estimate = concluded(model, rays, found.matches, found.fit, found.prior)
    return replace(estimate, alternative=found.alternative)


def _best_found(model: PlanarModel, rays: Rays, matches: BoolArray, prior: Prior) -> _Found:
    mount = prior.mount or prior.attitude
    anyhow = replace(prior, attitude=mount, bearings=None)
    everyone = np.ones_like(matches)
    try:
        found = _found(model, rays, matches, _likely(prior), _by_pairs)
    except DegenerateGeometryError:
        if not is_general(mount):
            raise
        return _found(model, rays, everyone, anyhow, _by_fives)
    is_poor = found.cost > POOR * WORST * rays.matches
    if not (is_general(mount) and (is_cold(prior.attitude) or is_poor)):
        return found
    try:
        other = _found(model, rays, everyone, anyhow, _by_fives)
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


def _found(
    model: PlanarModel, rays: Rays, matches: BoolArray, prior: Prior, refine: Refine
) -> _Found:
    matches = matches & plausible_matches(rays, prior)
    remaining = remaining_rays(rays, matches, model.min_matches)
    fits = refine(model, remaining, prior)
    mode, alternative = choose_mode(fits.parameters[:, : PHI + 1], fits.costs, prior)
    if alternative is None and not prior.decided and prior.lens.calibrated:
        alternative = _twin(model, remaining, fits.take(mode), prior)
    cost = float(fits.costs[mode]) + WORST * (rays.matches - remaining.matches)
    return _Found(fits.take(mode).of_all(matches), matches, prior, cost, alternative)


def _twin(model: PlanarModel, rays: Rays, fit: Fit, prior: Prior) -> Bearings | None:
    """Return the other geometry that a plane fits, where hypotheses have missed it; or None."""
    start = exchanged_on_plane(rays, fit)
    if start is None:
        return None
    twin = refined(start, model.problem(rays, prior), model.widening(rays, prior))
    # Of one plane both have the same residuals, across two directions: sums of N squares.
    by_chance = 3.0 * math.sqrt(4.0 * rays.matches)
    if not twin.costs < fit.costs + max(ALTERNATIVE_COST, by_chance):
        return None
    psi, phi = twin.parameters[: PHI + 1].tolist()
    apart = np.abs(np.sin(twin.parameters[: PHI + 1] - fit.parameters[: PHI + 1])).max()
    return Bearings(psi, phi) if apart > math.sin(SEPARATION) else None


def _by_pairs(model: PlanarModel, rays: Rays, prior: Prior) -> Fit:
    """Return the refined best modes of two-point hypotheses, and of the last bearings."""
    cold = is_cold(prior.attitude)
    with_jumps = partial(start_parameters, attitude=prior.attitude, jumps=JUMPS)
    first = partial(with_jumps, jumps=NO_JUMP) if cold else with_jumps
    fits = _refined_hypotheses(model, rays, prior, first)
    # A jump of the tilt may be more than hypotheses bear.
    is_poor = fits.costs.min() > POOR * WORST * rays.matches
    return _refined_hypotheses(model, rays, prior, with_jumps) if cold and is_poor else fits


def _by_fives(model: PlanarModel, rays: Rays, prior: Prior) -> Fit:
    """Return the refined best modes of five-point hypotheses."""
    hypotheses = partial(general_start_parameters, attitude=prior.attitude)
    return _refined_hypotheses(model, rays, prior, hypotheses, roughness=ROUGHNESS)


def _refined_hypotheses(
    model: PlanarModel,
    rays: Rays,
    prior: Prior,
    hypotheses: Callable[[Rays], FloatArray],
    roughness: float = 0.0,
) -> Fit:
    problem = model.problem(rays, prior)
    calibrated = prior.lens.calibrated
    starts = hypotheses(rays) if calibrated else starts_by_focal_lengths(rays, prior, hypotheses)
    if prior.bearings is not None:
        starts = np.vstack([starts, with_bearings(problem.prior.mean, prior)])
    least = roughness if calibrated else ROUGH_LENS
    fits = refined_modes(starts, problem, max(least, model.widening(rays, prior)))
    if not calibrated:
        return fits
    # A match that agrees from behind a camera costs as much as one that does not.
    agree = fits.squared <= WORST
    _, in_front = in_front_of(rays, agree, fits.parameters)
    dear = np.where(agree & ~in_front, WORST - fits.squared, 0.0).sum(axis=-1)
    return fits._replace(costs=fits.costs + dear)
