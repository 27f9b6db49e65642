"""Planar motion with a camera that is nearly upright: tilt, roll and floor jitter have priors."""

import math

import numpy as np

from visual_servo_epipolar.core.arrays import FloatArray
from visual_servo_epipolar.core.epipolar import Bearings, cheirality, fundamental_from_bearings
from visual_servo_epipolar.core.errors import DegenerateGeometryError
from visual_servo_epipolar.core.estimators.attitude import level, rotation_level_camera
from visual_servo_epipolar.core.estimators.base import Attitude, Estimate, Prior
from visual_servo_epipolar.core.estimators.planar import (
    diverse,
    forms,
    INLIER_DEVIATIONS,
    linearise,
    Linearised,
    Rays,
    rays_of,
    scores,
    tukey,
    two_point_hypotheses,
)
from visual_servo_epipolar.core.estimators.planar_2dof import chosen_mode

MIN_MATCHES = 5
PAIRS = 325
COLD = math.radians(0.3)  # above this deviation of the tilt, hypotheses are made for several tilts
TILTS = np.linspace(-1.0, 1.0, 9)  # of those, in deviations of the prior
MODES, MANY_MODES = 4, 10
POOR = 0.4  # part of the worst possible cost above which a fit is doubted
NO_JUMP = np.zeros(1)
JUMPS = 1.4 * np.array([-3.0, -2.0, -1.0, 1.0, 2.0, 3.0])  # of tilt between the views, in jitters
MODE_SPREAD = 0.07  # [rad]
ITERATIONS = 6
JITTER_DEVIATIONS = 3.0  # a prior tighter than the true jitter does harm
LEAST_JITTER = 1e-4  # [rad]
PSI, PHI, TILT, ROLL, TILT_JUMP, ROLL_JUMP = range(6)


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
    six parameters with ``prior.attitude``, the lowest truncated cost wins. A camera whose attitude
    is not known yet costs several tilts to try. ``rng`` is not needed.

    Raises
    ------
    DegenerateGeometryError
        With fewer than five matches, or all of them on the horizon.

    """
    del rng
    attitude = prior.attitude
    if len(current) < MIN_MATCHES:
        raise DegenerateGeometryError(
            f'bearings need {MIN_MATCHES} matches, got {len(current)}; track more features'
        )
    rays = rays_of(current, desired)
    found, normal, costs = _solutions(rays, noise, prior, NO_JUMP)
    if costs.min() > POOR * INLIER_DEVIATIONS**2 * len(current):
        # Few matches agree: the floor may have tilted the camera more than rigid hypotheses bear.
        jumps = np.concatenate([NO_JUMP, attitude.jitter * JUMPS])
        found, normal, costs = _solutions(rays, noise, prior, jumps)
    psi, phi = found[:, PSI], found[:, PHI]
    best, rival = chosen_mode(psi, phi, costs * noise**2, noise, prior)
    return _estimate(found[best], normal[best], rival, rays, noise, attitude)


def _solutions(
    rays: Rays, noise: float, prior: Prior, jumps: FloatArray
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Return refined parameters, normal matrices and costs of the best modes."""
    start = _candidates(rays, noise, prior, jumps)
    found, normal = _refined(start, rays, noise, prior.attitude)
    return found, normal, _costs(found, rays, noise, prior.attitude)


def _candidates(rays: Rays, noise: float, prior: Prior, jumps: FloatArray) -> FloatArray:
    """Return the best hypotheses of different modes as parameters, shape (K, 6)."""
    attitude = prior.attitude
    cold = attitude.tilt_deviation > COLD
    tilts = attitude.tilt + attitude.tilt_deviation * TILTS if cold else [attitude.tilt]
    slack = INLIER_DEVIATIONS * math.hypot(noise, 0.7 * attitude.jitter)
    chosen = [
        _hypotheses(rays, float(tilt), float(jump), slack, prior)
        for tilt in tilts
        for jump in jumps
    ]
    hypotheses = np.concatenate([found for found, _ in chosen])
    costs = np.concatenate([cost for _, cost in chosen])
    if not len(hypotheses):
        raise DegenerateGeometryError(
            'all matches lie on the horizon, where planar motion does not show; '
            "track features above and below the camera's height"
        )
    several = cold or len(jumps) > 1
    spread = 0.5 * MODE_SPREAD if several else MODE_SPREAD
    best = diverse(hypotheses, costs, MANY_MODES if several else MODES, spread=spread)
    start = np.zeros((len(best), 6))
    start[:, PSI] = np.arctan2(best[:, 1], best[:, 0])
    start[:, PHI] = np.arctan2(best[:, 3], best[:, 2])
    start[:, ROLL] = attitude.roll
    start[:, [TILT, TILT_JUMP]] = best[:, 4:]
    return start


def _hypotheses(
    rays: Rays, tilt: float, jump: float, threshold: float, prior: Prior
) -> tuple[FloatArray, FloatArray]:
    """Return hypotheses for one tilt and jump, (H, 6) with these two last, and their costs."""
    roll = prior.attitude.roll
    upright = Rays(
        *level(rays.u_a, rays.v_a, tilt + jump, roll), *level(rays.u_d, rays.v_d, tilt, roll)
    )
    found = two_point_hypotheses(upright, PAIRS)
    if prior.bearings is not None:
        psi, phi = prior.bearings.psi, prior.bearings.phi
        found = np.vstack([found, [np.cos(psi), np.sin(psi), np.cos(phi), np.sin(phi)]])
    costs = scores(found, forms(upright), threshold)
    keep = np.argsort(costs)[:64]
    return np.column_stack([found[keep], np.full((len(keep), 2), [tilt, jump])]), costs[keep]


def _upright(parameters: FloatArray, rays: Rays) -> Rays:
    """Return the rays as the upright cameras of each candidate see them, shape (K, N) each."""
    _, _, tilt, roll, tilt_jump, roll_jump = parameters.T[:, :, None]
    u_a, v_a = level(rays.u_a, rays.v_a, tilt + tilt_jump, roll + roll_jump)
    u_d, v_d = level(rays.u_d, rays.v_d, tilt, roll)
    return Rays(u_a, v_a, u_d, v_d)


def _linearised(parameters: FloatArray, rays: Rays) -> tuple[Linearised, Rays]:
    upright = _upright(parameters, rays)
    psi, phi = parameters[:, PSI, None], parameters[:, PHI, None]
    return linearise(psi, phi, upright), upright


def _jacobian(at: Linearised, upright: Rays, parameters: FloatArray) -> FloatArray:
    """Return the derivatives of the distances by the six parameters, shape (K, 6, N)."""
    u_a, v_a, u_d, v_d = upright
    p1, q0 = np.sin(parameters[:, PSI, None]), np.cos(parameters[:, PHI, None])
    along_a, along_d = q0 * v_d, -p1 * v_a  # derivatives of r by u_a and u_d; by v: the sides
    # A tilt moves a ray by (u v, 1 + v^2), a roll by (-v, u).
    tilt_a = (along_a * u_a * v_a + at.side_a * (1.0 + v_a * v_a)) / at.gradient
    tilt_d = (along_d * u_d * v_d + at.side_d * (1.0 + v_d * v_d)) / at.gradient
    roll_a = (at.side_a * u_a - along_a * v_a) / at.gradient
    roll_d = (at.side_d * u_d - along_d * v_d) / at.gradient
    return np.stack(
        [at.by_psi, at.by_phi, tilt_a + tilt_d, roll_a + roll_d, tilt_a, roll_a], axis=1
    )


def _prior(attitude: Attitude) -> tuple[FloatArray, FloatArray]:
    """Return mean and information of the six parameters, shape (6,) each."""
    jump = max(JITTER_DEVIATIONS * attitude.jitter, LEAST_JITTER)
    mean = np.array([0.0, 0.0, attitude.tilt, attitude.roll, 0.0, 0.0])
    deviation = np.array([attitude.tilt_deviation, attitude.roll_deviation, jump, jump])
    return mean, np.concatenate([[0.0, 0.0], 1.0 / deviation**2])


def _refined(
    parameters: FloatArray, rays: Rays, noise: float, attitude: Attitude
) -> tuple[FloatArray, FloatArray]:
    """Return refined parameters, (K, 6), and the normal matrix of each, (K, 6, 6)."""
    mean, information = _prior(attitude)
    scale = max(1.0, 0.7 * attitude.jitter / noise)
    ridge = np.diag(information + [1e-3, 1e-3, 0.0, 0.0, 0.0, 0.0])
    for iteration in range(ITERATIONS):
        at, upright = _linearised(parameters, rays)
        # Annealed: the first steps must not lose matches that only the jitter holds off.
        deviation = noise * (1.0 + (scale - 1.0) * max(0.0, 1.0 - iteration / 3.0))
        jacobian = _jacobian(at, upright, parameters)
        weighted = jacobian * (tukey(at.distance, deviation) / noise**2)[:, None, :]
        normal = weighted @ np.swapaxes(jacobian, 1, 2) + ridge
        pull = (weighted @ at.distance[:, :, None])[:, :, 0] + information * (parameters - mean)
        step = np.linalg.solve(normal, pull[:, :, None])[:, :, 0]
        parameters = parameters - np.clip(step, -0.2, 0.2)
    return parameters, normal


def _costs(parameters: FloatArray, rays: Rays, noise: float, attitude: Attitude) -> FloatArray:
    """Return truncated squared distances in deviations, plus the price of the prior, (K,)."""
    at, _ = _linearised(parameters, rays)
    squared = np.minimum((at.distance / noise) ** 2, INLIER_DEVIATIONS**2)
    squared[at.side_a * at.side_d > 0.0] = INLIER_DEVIATIONS**2
    mean, information = _prior(attitude)
    return np.asarray(squared.sum(axis=1) + (parameters - mean) ** 2 @ information)


def _estimate(
    parameters: FloatArray,
    normal: FloatArray,
    rival: Bearings | None,
    rays: Rays,
    noise: float,
    attitude: Attitude,
) -> Estimate:
    at, upright = _linearised(parameters[None], rays)
    near = np.abs(at.distance[0]) <= INLIER_DEVIATIONS * noise
    inliers = near & (at.side_a[0] * at.side_d[0] < 0.0)
    u_a, v_a, u_d, v_d = (coordinate[0][inliers] for coordinate in upright)
    vote = cheirality(
        Bearings(float(parameters[PSI]), float(parameters[PHI])),
        np.stack([u_a, v_a], axis=1),
        np.stack([u_d, v_d], axis=1),
        noise=noise,
    )
    covariance = np.linalg.inv(normal)
    tilt, roll, tilt_jump, roll_jump = (float(value) for value in parameters[TILT:])
    to_desired = rotation_level_camera(tilt, roll)
    to_current = rotation_level_camera(tilt + tilt_jump, roll + roll_jump)
    return Estimate(
        vote.bearings,
        to_desired.T @ fundamental_from_bearings(vote.bearings) @ to_current,
        inliers,
        vote.confidence,
        np.asarray(covariance[:2, :2], dtype=np.float64),
        attitude=Attitude(
            tilt,
            roll,
            math.sqrt(covariance[TILT, TILT]),
            math.sqrt(covariance[ROLL, ROLL]),
            attitude.jitter,
        ),
        rival=rival,
        jump=math.hypot(tilt_jump, roll_jump),
    )
