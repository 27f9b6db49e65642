"""Planar motion with a camera that is nearly upright: tilt, roll and floor jitter have priors."""

from collections.abc import Callable, Sequence
import math
from typing import Any, NamedTuple

import numpy as np

from visual_servo_epipolar.core.arrays import BoolArray, FloatArray
from visual_servo_epipolar.core.estimators.base import Attitude, Estimate, Prior
from visual_servo_epipolar.core.estimators.machinery.attitude import Attitudes, attitudes_of, level
from visual_servo_epipolar.core.estimators.machinery.batch import (
    alone,
    Answer,
    answers,
    Method,
    Views,
    views_of,
)
from visual_servo_epipolar.core.estimators.machinery.hypotheses import (
    chosen_mode,
    fused,
    INLIER_DEVIATIONS,
    modes,
    plausible,
    Rays,
    scores,
    SPREAD,
    two_point_hypotheses,
    undetermined,
)
from visual_servo_epipolar.core.estimators.machinery.refinement import (
    Belief,
    Fit,
    followed,
    NEGLIGIBLE,
    problem,
    refined,
)
from visual_servo_epipolar.core.estimators.machinery.sampson import table_of
from visual_servo_epipolar.core.estimators.machinery.tilted_planar import (
    cameras,
    matrices,
    PHI,
    PSI,
    ROLL,
    ROLL_JUMP,
    TILT,
    TILT_JUMP,
    TO_CAMERAS,
)
from visual_servo_epipolar.core.geometry.cheirality import balances, oriented
from visual_servo_epipolar.core.geometry.epipolar import Bearings, fundamentals

MIN_MATCHES = 5
COLD = math.radians(0.3)  # above this deviation of the tilt, hypotheses are made for several tilts
TILTS = np.linspace(-1.0, 1.0, 9)  # of those, in deviations of the prior
PAIRS = 60  # for each attitude that is tried
MODES = 6
POOR = 0.4  # part of the worst possible cost above which a fit is doubted
NO_JUMP = np.zeros(1)
JUMPS = np.array([-3.2, -1.6, 0.0, 1.6, 3.2])  # of tilt between the views, in jitters
JITTER_DEVIATIONS = 3.0  # a prior tighter than the true jitter does harm
LEAST_JITTER = 1e-4  # [rad]


def soft_planar(
    current: FloatArray,
    desired: FloatArray,
    *,
    noise: float,
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
    return alone(current, desired, noise, prior, METHOD)


def soft_planar_each(
    current: FloatArray, desired: FloatArray, *, noise: FloatArray, priors: Sequence[Prior]
) -> list[Answer]:
    """Do the same for many pairs of views, rays of shape (B, N, 2) each; errors are answers."""
    return answers(views_of(current, desired, noise, priors), METHOD)


def _keep(views: Views) -> BoolArray:
    return kept(views, 1.0)


def kept(views: Views, stretch: FloatArray | float) -> BoolArray:
    """
    Return the matches that lie on the same side of the horizon, as far as that is known.

    Rays may be longer by ``stretch``, shape (B, 1), and so is then what a tilt makes of them.
    """
    known, rays = attitudes_of(views.priors), views.rays
    u, v = np.array([rays.u_a, rays.u_d]), np.array([rays.v_a, rays.v_d])
    (u_a, u_d), (v_a, v_d) = level(u, v, known.tilt, known.roll)
    slack = 2.0 * (known.tilt_deviation + known.roll_deviation)
    slack += threshold_of(views.noise[:, None], known.jitter)
    return plausible(Rays(u_a, v_a, u_d, v_d), stretch * slack)


def threshold_of(noise: Any, jitter: Any) -> Any:
    """Return the distance within which a match agrees with a rigid hypothesis."""
    return INLIER_DEVIATIONS * np.hypot(noise, 0.7 * jitter)


def _follow(views: Views, kept: BoolArray) -> Fit:
    known = attitudes_of(views.priors)
    belief = belief_of(known)
    start = belief.mean.copy()
    start[:, [PSI, PHI]] = views.before
    return followed(
        start,
        problem(matrices, table_of(views.rays, views.noise, kept), belief),
        negligible=NEGLIGIBLE * views.noise,
        scale=np.maximum(1.0, 0.7 * known.jitter[:, 0] / views.noise),
    )


def _search(rays: Rays, noise: float, prior: Prior) -> tuple[Fit, int, Bearings | None]:
    table = table_of(rays, noise)
    return searched(lambda jumps: _solutions(rays, table, noise, prior, jumps), prior, rays)


def searched(
    solutions: Callable[[FloatArray], Fit], prior: Prior, rays: Rays
) -> tuple[Fit, int, Bearings | None]:
    """
    Return refined fits, the best one's place, and an alternative; a cold camera costs more.

    ``solutions`` refines hypotheses with jumps of the tilt, in jitters.
    """
    cold = prior.attitude.tilt_deviation > COLD
    found = solutions(NO_JUMP if cold else JUMPS)
    if cold and found.costs.min() > POOR * INLIER_DEVIATIONS**2 * len(rays.u_a):
        # Few matches agree: the floor may have tilted the camera more than hypotheses bear.
        found = solutions(JUMPS)
    best, alternative = chosen_mode(found.parameters[:, : PHI + 1], found.costs, prior)
    return found, best, alternative


def _solutions(
    rays: Rays, table: FloatArray, noise: float, prior: Prior, jumps: FloatArray
) -> Fit:
    """Return the refined best modes of the hypotheses, and of the last bearings."""
    attitude = prior.attitude
    belief = belief_of(attitudes_of([prior]))
    belief = Belief(belief.mean[0], belief.information[0])
    start = candidates(rays, noise, attitude, jumps)
    if prior.bearings is not None:
        start = np.vstack([start, belief.mean])
        start[-1, [PSI, PHI]] = prior.bearings.psi, prior.bearings.phi
    return refined(
        start,
        problem(matrices, table, belief),
        negligible=NEGLIGIBLE * noise,
        scale=max(1.0, 0.7 * attitude.jitter / noise),
    )


def candidates(rays: Rays, noise: float, attitude: Attitude, jumps: FloatArray) -> FloatArray:
    """Return the best hypotheses of different modes as parameters, shape (K, 6)."""
    cold = attitude.tilt_deviation > COLD
    tilts = attitude.tilt + (attitude.tilt_deviation * TILTS if cold else np.zeros(1))
    grid = np.stack(np.meshgrid(tilts, attitude.jitter * jumps), axis=-1).reshape(-1, 2)
    tilt, jump = grid[:, :1], grid[:, 1:]
    upright = Rays(
        *level(rays.u_a, rays.v_a, tilt + jump, attitude.roll),
        *level(rays.u_d, rays.v_d, tilt, attitude.roll),
    )
    hypotheses = two_point_hypotheses(upright, PAIRS)
    costs = scores(hypotheses, upright, float(threshold_of(noise, attitude.jitter))).ravel()
    each = hypotheses.shape[-1]
    hypotheses = hypotheses.swapaxes(0, 1).reshape(2, -1)
    best = modes(hypotheses, costs, MODES, spread=0.5 * SPREAD)
    start = np.zeros((len(best), 6))
    start[:, [PSI, PHI]] = np.angle(hypotheses[:, best]).T
    start[:, ROLL] = attitude.roll
    start[:, [TILT, TILT_JUMP]] = grid[best // each]
    return start


def belief_of(known: Attitudes) -> Belief:
    """Return what is known of the six parameters, shape (B, 6) each."""
    mean, information = np.zeros((2, len(known.tilt), 6))
    mean[:, TILT], mean[:, ROLL] = known.tilt[:, 0], known.roll[:, 0]
    information[:, TILT] = known.tilt_deviation[:, 0] ** -2.0
    information[:, ROLL] = known.roll_deviation[:, 0] ** -2.0
    jump = np.maximum(JITTER_DEVIATIONS * known.jitter[:, 0], LEAST_JITTER)
    information[:, TILT_JUMP] = information[:, ROLL_JUMP] = jump**-2.0
    return Belief(mean, information)


def _conclude(
    views: Views, kept: BoolArray, fit: Fit, rivals: Sequence[Bearings | None]
) -> list[Answer]:
    covariance = fit.covariance()
    found, determined = fused(fit.parameters, covariance, views.before, views.deviation)
    agree = kept & (fit.squared <= INLIER_DEVIATIONS**2)
    return concluded(views, agree, Fused(found, covariance, determined), rivals)


class Fused(NamedTuple):
    """Parameters, (B, 6), their covariance, (B, 6, 6), and where they are determined, (B,)."""

    parameters: FloatArray
    covariance: FloatArray
    determined: BoolArray


def concluded(
    views: Views, agree: BoolArray, fit: Fused, rivals: Sequence[Bearings | None]
) -> list[Answer]:
    """Return the estimates, of matches that ``agree`` with them, (B, N)."""
    found, covariance, determined = fit
    numbers = np.exp(1j * (found @ TO_CAMERAS))  # of psi, phi, tilt and roll of both views
    rays = _levelled(views.rays, found)
    agree = agree & plausible(rays, INLIER_DEVIATIONS * views.noise[:, None])
    balance = balances(numbers[:, :2], rays.u_a, rays.u_d, agree, views.noise)
    both = cameras(numbers)
    fundamental = both[:, 0].swapaxes(1, 2) @ fundamentals(numbers[:, :2], balance) @ both[:, 1]
    deviations = np.sqrt(covariance[:, [TILT, ROLL], [TILT, ROLL]]).tolist()
    rows = zip(found.tolist(), balance.tolist(), deviations, views.priors, rivals, strict=True)
    return [
        Estimate(
            oriented(row[PSI], row[PHI], vote),
            fundamental[k],
            agree[k],
            min(abs(vote), 1.0),
            covariance[k, :2, :2],
            attitude=Attitude(row[TILT], row[ROLL], known[0], known[1], prior.attitude.jitter),
            alternative=alternative,
            jump=math.hypot(row[TILT_JUMP], row[ROLL_JUMP]),
        )
        if determined[k]
        else undetermined()
        for k, (row, vote, known, prior, alternative) in enumerate(rows)
    ]


def _levelled(rays: Rays, found: FloatArray) -> Rays:
    """Return ``rays``, (B, N), as upright cameras would see them, after ``found``, (B, 6)."""
    # Of the current and of the desired camera, (2, B, 1).
    tilt, roll = (np.array([now, now])[..., None] for now in (found[:, TILT], found[:, ROLL]))
    tilt[0, :, 0] += found[:, TILT_JUMP]
    roll[0, :, 0] += found[:, ROLL_JUMP]
    u, v = np.array([rays.u_a, rays.u_d]), np.array([rays.v_a, rays.v_d])
    (u_a, u_d), (v_a, v_d) = level(u, v, tilt, roll)
    return Rays(u_a, v_a, u_d, v_d)


METHOD = Method(MIN_MATCHES, _keep, _follow, _search, _conclude)
