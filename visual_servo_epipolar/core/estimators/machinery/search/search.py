"""
Search of the geometry of a pair of views where no bearings are known, or none that fit.

A camera that may be mounted any way is most likely level, or as it was learnt to be: hypotheses
by pairs of matches, which need the attitude nearly, come first. Those by five matches, which need
nothing, are believed where the matches speak for them by more than chance.
"""

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np

from visual_servo_epipolar.core.arrays import BoolArray
from visual_servo_epipolar.core.errors import DegenerateGeometryError
from visual_servo_epipolar.core.estimators.base import (
    Attitude,
    COLD_DEVIATION,
    Estimate,
    Prior,
)
from visual_servo_epipolar.core.estimators.machinery.attitude_prior import plausible_matches
from visual_servo_epipolar.core.estimators.machinery.hypotheses import (
    ALTERNATIVE_COST,
    choose_mode,
    INLIER_DEVIATIONS,
    Rays,
    too_few,
)
from visual_servo_epipolar.core.estimators.machinery.refinement import Fit
from visual_servo_epipolar.core.estimators.machinery.search.tilted_hypotheses import (
    is_cold,
    is_general,
    POOR,
)
from visual_servo_epipolar.core.estimators.machinery.tilted_planar import PHI
from visual_servo_epipolar.core.geometry.epipolar import Bearings

WORST = INLIER_DEVIATIONS**2  # cost of a match that does not agree


@dataclass(frozen=True, slots=True)
class SearchMethod:
    """
    What is the estimator's own in a search; ``min_matches`` are needed.

    ``by_pairs`` and ``by_fives`` refine the best modes of hypotheses of the one and of the other
    kind, ``estimate`` concludes from the fit to all matches; ``stretch`` says by how much angles
    may truly be larger.
    """

    min_matches: int
    by_pairs: Callable[[Rays, Prior], Fit]
    by_fives: Callable[[Rays, Prior], Fit]
    estimate: Callable[[Rays, BoolArray, Fit, Prior, Bearings | None], Estimate]
    stretch: Callable[[Prior], float] = lambda prior: 1.0


@dataclass(frozen=True, slots=True)
class _Found:
    """The best fit to all N matches, those it was made of, its ``cost``, what else fits."""

    fit: Fit
    matches: BoolArray
    prior: Prior
    cost: float
    alternative: Bearings | None


def likely_attitude(attitude: Attitude) -> Attitude:
    """Return the ``attitude`` as it most likely is: near its mean, if a mount may be any."""
    if not is_general(attitude):
        return attitude
    return replace(
        attitude,
        tilt_deviation=min(attitude.tilt_deviation, COLD_DEVIATION),
        roll_deviation=min(attitude.roll_deviation, COLD_DEVIATION),
    )


def searched(rays: Rays, matches: BoolArray, prior: Prior, method: SearchMethod) -> Estimate:
    """
    Return the best estimate of one pair of views, of which the plausible ``matches`` are (N,).

    Raises
    ------
    DegenerateGeometryError
        With too few matches, or where they leave the geometry open.

    """
    likely = replace(prior, attitude=likely_attitude(prior.attitude))
    mount = prior.mount or prior.attitude
    anyhow = replace(prior, attitude=mount, bearings=None) if is_general(mount) else None
    try:
        found = _found(rays, matches, likely, method, method.by_pairs)
    except DegenerateGeometryError:
        if anyhow is None:
            raise
        found = _found(rays, np.ones_like(matches), anyhow, method, method.by_fives)
        return _estimate(rays, found, method)
    if anyhow is not None and (is_cold(prior.attitude) or _is_poor(found)):
        found = _better(rays, found, anyhow, method)
    return _estimate(rays, found, method)


def _better(rays: Rays, found: _Found, anyhow: Prior, method: SearchMethod) -> _Found:
    """Return what is ``found``, or a camera mounted any way if matches speak for that clearly."""
    try:
        other = _found(rays, np.ones_like(found.matches), anyhow, method, method.by_fives)
    except DegenerateGeometryError:
        return found
    return other if other.cost < found.cost - ALTERNATIVE_COST else found


def _is_poor(found: _Found) -> bool:
    """Return whether few of the matches agree."""
    return bool(found.cost > POOR * WORST * len(found.matches))


def _found(
    rays: Rays,
    matches: BoolArray,
    prior: Prior,
    method: SearchMethod,
    refine: Callable[[Rays, Prior], Fit],
) -> _Found:
    matches = matches & plausible_matches(rays, prior.attitude, method.stretch(prior))
    remaining = rays.take(matches)
    if remaining.matches < method.min_matches:
        raise too_few(remaining.matches, rays.matches, method.min_matches)
    fits = refine(remaining, prior)
    mode, alternative = choose_mode(fits.parameters[:, : PHI + 1], fits.costs, prior)
    dropped = rays.matches - remaining.matches
    cost = float(fits.costs[mode]) + WORST * dropped
    return _Found(fits.take(mode).of_all(matches), matches, prior, cost, alternative)


def _estimate(rays: Rays, found: _Found, method: SearchMethod) -> Estimate:
    return method.estimate(rays, found.matches, found.fit, found.prior, found.alternative)
