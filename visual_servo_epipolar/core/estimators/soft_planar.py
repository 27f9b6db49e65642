"""Planar motion with a camera that is nearly upright: tilt, roll and floor jitter have priors."""

import math

import numpy as np

from visual_servo_epipolar.core.arrays import BoolArray, FloatArray
from visual_servo_epipolar.core.cheirality import cheirality
from visual_servo_epipolar.core.epipolar import Bearings, fundamental_from_bearings
from visual_servo_epipolar.core.errors import DegenerateGeometryError
from visual_servo_epipolar.core.estimators.attitude import level, rotation_level_camera
from visual_servo_epipolar.core.estimators.base import Attitude, Estimate, Prior
from visual_servo_epipolar.core.estimators.nearly_upright import (
    matrices,
    PHI,
    PSI,
    ROLL,
    ROLL_JUMP,
    TILT,
    TILT_JUMP,
)
from visual_servo_epipolar.core.estimators.planar import (
    chosen_mode,
    fused,
    INLIER_DEVIATIONS,
    modes,
    plausible,
    Rays,
    rays_of,
    scores,
    SPREAD,
    two_point_hypotheses,
)
from visual_servo_epipolar.core.estimators.sampson import (
    Belief,
    Fit,
    NEGLIGIBLE,
    refined,
    table_of,
)

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
    attitude = prior.attitude
    rays = rays_of(current, desired)
    kept = _kept(rays, noise, attitude)
    if not kept.all():
        rays = Rays(*(coordinate[kept] for coordinate in rays))
    if len(rays.u_a) < MIN_MATCHES:
        raise DegenerateGeometryError(
            f'bearings need {MIN_MATCHES} matches on one side of the horizon in both views, got '
            f'{len(rays.u_a)} of {len(kept)}; track more features'
        )
    table = table_of(rays, noise)
    if prior.bearings is not None:
        found = _refined(_start(prior.bearings, attitude), table, noise, attitude)
        if found.goes_on(prior):
            return _estimate(found, 0, None, rays, kept, noise, prior)
    cold = attitude.tilt_deviation > COLD
    found = _solutions(rays, table, noise, prior, NO_JUMP if cold else JUMPS)
    if cold and found.costs.min() > POOR * INLIER_DEVIATIONS**2 * len(rays.u_a):
        # Few matches agree: the floor may have tilted the camera more than hypotheses bear.
        found = _solutions(rays, table, noise, prior, JUMPS)
    best, rival = chosen_mode(found.parameters[:, : PHI + 1], found.costs, prior)
    return _estimate(found, best, rival, rays, kept, noise, prior)


def _kept(rays: Rays, noise: float, attitude: Attitude) -> BoolArray:
    """Return the matches that lie on the same side of the horizon, as far as that is known."""
    u_a, v_a = level(rays.u_a, rays.v_a, attitude.tilt, attitude.roll)
    u_d, v_d = level(rays.u_d, rays.v_d, attitude.tilt, attitude.roll)
    attitude_slack = attitude.tilt_deviation + attitude.roll_deviation
    return plausible(Rays(u_a, v_a, u_d, v_d), 2.0 * attitude_slack + _threshold(noise, attitude))


def _threshold(noise: float, attitude: Attitude) -> float:
    """Return the distance within which a match agrees with a rigid hypothesis."""
    return INLIER_DEVIATIONS * math.hypot(noise, 0.7 * attitude.jitter)


def _solutions(
    rays: Rays, table: FloatArray, noise: float, prior: Prior, jumps: FloatArray
) -> Fit:
    """Return the refined best modes of the hypotheses, and of the last bearings."""
    attitude = prior.attitude
    start = _candidates(rays, noise, attitude, jumps)
    if prior.bearings is not None:
        start = np.vstack([start, _start(prior.bearings, attitude)])
    return _refined(start, table, noise, attitude)


def _start(before: Bearings, attitude: Attitude) -> FloatArray:
    """Return the parameters of the last bearings, shape (1, 6)."""
    start = _belief(attitude).mean[None].copy()
    start[0, PSI], start[0, PHI] = before.psi, before.phi
    return start


def _candidates(rays: Rays, noise: float, attitude: Attitude, jumps: FloatArray) -> FloatArray:
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
    costs = scores(hypotheses, upright, _threshold(noise, attitude)).ravel()
    each = hypotheses.shape[-1]
    hypotheses = hypotheses.swapaxes(0, 1).reshape(2, -1)
    best = modes(hypotheses, costs, MODES, spread=0.5 * SPREAD)
    start = np.zeros((len(best), 6))
    start[:, [PSI, PHI]] = np.angle(hypotheses[:, best]).T
    start[:, ROLL] = attitude.roll
    start[:, [TILT, TILT_JUMP]] = grid[best // each]
    return start


def _belief(attitude: Attitude) -> Belief:
    """Return what is known of the six parameters."""
    mean, information = np.zeros(6), np.zeros(6)
    mean[TILT], mean[ROLL] = attitude.tilt, attitude.roll
    information[TILT] = attitude.tilt_deviation**-2.0
    information[ROLL] = attitude.roll_deviation**-2.0
    jump = max(JITTER_DEVIATIONS * attitude.jitter, LEAST_JITTER)
    information[[TILT_JUMP, ROLL_JUMP]] = jump**-2.0
    return Belief(mean, information)


def _refined(start: FloatArray, table: FloatArray, noise: float, attitude: Attitude) -> Fit:
    return refined(
        start,
        matrices,
        table,
        _belief(attitude),
        negligible=NEGLIGIBLE * noise,
        scale=max(1.0, 0.7 * attitude.jitter / noise),
    )


def _estimate(
    found: Fit,
    best: int,
    rival: Bearings | None,
    rays: Rays,
    kept: BoolArray,
    noise: float,
    prior: Prior,
) -> Estimate:
    covariance = found.covariance(best)
    psi, phi, tilt, tilt_jump, roll, roll_jump = fused(
        found.parameters[best], covariance, prior
    ).tolist()
    agree = found.squared[best] <= INLIER_DEVIATIONS**2
    u_a, v_a = level(rays.u_a, rays.v_a, tilt + tilt_jump, roll + roll_jump)
    u_d, v_d = level(rays.u_d, rays.v_d, tilt, roll)
    agree &= plausible(Rays(u_a, v_a, u_d, v_d), INLIER_DEVIATIONS * noise)
    inliers = kept.copy()
    inliers[kept] = agree
    current = np.array([u_a[agree], v_a[agree]]).T
    desired = np.array([u_d[agree], v_d[agree]]).T
    vote = cheirality(Bearings(psi, phi), current, desired, noise=noise)
    to_desired = rotation_level_camera(tilt, roll)
    to_current = rotation_level_camera(tilt + tilt_jump, roll + roll_jump)
    return Estimate(
        vote.bearings,
        to_desired.T @ fundamental_from_bearings(vote.bearings) @ to_current,
        inliers,
        vote.confidence,
        covariance[:2, :2],
        attitude=Attitude(
            tilt,
            roll,
            math.sqrt(covariance[TILT, TILT]),
            math.sqrt(covariance[ROLL, ROLL]),
            prior.attitude.jitter,
        ),
        rival=rival,
        jump=math.hypot(tilt_jump, roll_jump),
    )
