"""
Planar motion seen by a camera that is not quite upright: E and its derivatives by six parameters.

E = C_d^T F C_a with C = R_x(tilt) R_z(roll) from camera to level axes. The derivatives by tilt put
the generator S_x beside F, those by roll put S_z beside E; both are linear. The attitude known
before says something of the parameters, and of which matches are plausible.
"""

import math
from typing import Any

import numpy as np

from visual_servo_epipolar.core.arrays import BoolArray, ComplexArray, FloatArray, TINY
from visual_servo_epipolar.core.geometry.cheirality import oriented
from visual_servo_epipolar.core.geometry.epipolar import fundamentals, rotation_desired_current
from visual_servo_epipolar.core.geometry.motion import HALF_PI
from visual_servo_epipolar.core.geometry.rays import level
from visual_servo_epipolar.core.geometry.wall import exchanged_bearings
from visual_servo_epipolar.core.twoview.estimator import Attitude, Estimate, LEAST_JITTER, Prior
from visual_servo_epipolar.core.twoview.hypotheses import (
    FAMILIES,
    INLIER_DEVIATIONS,
    plausible,
    Rays,
)
from visual_servo_epipolar.core.twoview.planar import balances_in_front, JITTER_SHARE, Posterior
from visual_servo_epipolar.core.twoview.refinement import Fit, GaussianPrior

PSI, PHI, TILT, TILT_JUMP, ROLL, ROLL_JUMP = range(6)  # jump: current less desired view
BOTH = slice(TILT, ROLL + 1, ROLL - TILT)  # tilt and roll
JITTER_DEVIATIONS = 3.0  # a prior tighter than the true jitter does harm
REACH = 2.0  # how far hypotheses of the focal length reach, in deviations of the prior

# psi, phi, tilt and roll of the desired camera, tilt and roll of the current one
TO_CAMERAS = np.zeros((6, 6))
TO_CAMERAS[[PSI, PHI, TILT, ROLL], [0, 1, 2, 3]] = 1.0
TO_CAMERAS[[TILT, TILT_JUMP], 4] = TO_CAMERAS[[ROLL, ROLL_JUMP], 5] = 1.0

S_X = np.array([[0.0, 0.0, 0.0], [0.0, 0.0, 1.0], [0.0, -1.0, 0.0]])
S_Z = np.array([[0.0, -1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, 0.0]])


def _inner() -> FloatArray:
    """Return what turns (p0, p1, q0, q1) into F and its derivatives but those by roll, (4, 45)."""
    families = FAMILIES.reshape(4, 3, 3, 3)
    plain = families[:, 0]
    jump = plain @ S_X
    both = jump - S_X @ plain
    parts = np.concatenate([families, both[:, None], jump[:, None]], axis=1)
    return np.asarray(parts.reshape(4, 45))


def _rolls() -> FloatArray:
    """Return what turns E into its derivatives by roll and roll jump, shape (9, 18)."""
    plain = np.eye(9).reshape(9, 3, 3)
    jump = plain @ S_Z
    return np.stack([jump - S_Z @ plain, jump], axis=1).reshape(9, 18)


def _products() -> FloatArray:
    """Return what turns (ct, st, 1) times (cr, sr, 1) into R_x(tilt) R_z(roll), shape (9, 9)."""
    products = np.zeros((3, 3, 3, 3))
    products[2, 0, 0, 0] = products[0, 1, 1, 0] = products[0, 0, 1, 1] = products[1, 2, 1, 2] = 1.0
    products[2, 1, 0, 1] = products[1, 1, 2, 0] = products[1, 0, 2, 1] = -1.0
    products[0, 2, 2, 2] = 1.0
    return products.reshape(9, 9)


INNER, ROLLS, PRODUCTS = _inner(), _rolls(), _products()


def matrices(parameters: FloatArray) -> FloatArray:
    """Return E and its derivatives by ``parameters``, shape (..., 6), as rows: (..., 7, 9)."""
    *leading, _ = parameters.shape
    phasors = phasors_of(parameters)
    inner = (phasors.view(np.float64)[..., :4] @ INNER).reshape(*leading, 5, 3, 3)
    both = cameras(phasors)
    desired, current = both[..., :1, :, :], both[..., 1:, :, :]
    rows = np.empty((*leading, 7, 9))
    plain = rows.reshape(*leading, 7, 3, 3)[..., :5, :, :]
    np.matmul(desired.swapaxes(-2, -1) @ inner, current, out=plain)
    rows[..., 5:, :] = (rows[..., 0, :] @ ROLLS).reshape(*leading, 2, 9)
    return rows


def phasors_of(parameters: FloatArray) -> ComplexArray:
    """Return exp(i angle) in the order of TO_CAMERAS, shape (..., 6)."""
    return np.asarray(np.exp(1j * (parameters @ TO_CAMERAS)))


def cameras(phasors: ComplexArray) -> FloatArray:
    """
    Return R_x(tilt) R_z(roll) of the desired and of the current camera, shape (..., 2, 3, 3).

    ``phasors``, shape (..., 6), are exp(i angle) in the order of TO_CAMERAS.
    """
    *leading, _ = phasors.shape
    factors = np.ones((*leading, 2, 2, 3))
    factors[..., :2] = phasors[..., 2:].view(np.float64).reshape(*leading, 2, 2, 2)
    products = factors[..., 0, :, None] * factors[..., 1, None, :]
    return np.asarray((products.reshape(*leading, 2, 9) @ PRODUCTS).reshape(*leading, 2, 3, 3))


def attitude_prior(prior: Prior) -> GaussianPrior:
    """Return what is known of the six parameters."""
    attitude = prior.attitude
    tilt, roll, both = attitude.tilt_deviation, attitude.roll_deviation, attitude.correlation
    jump = max(JITTER_DEVIATIONS * attitude.jitter, LEAST_JITTER)
    mean, information = np.zeros(6), np.zeros((6, 6))
    mean[TILT], mean[ROLL] = attitude.tilt, attitude.roll
    alone = 1.0 / (1.0 - both * both)
    information[TILT, TILT] = alone / (tilt * tilt)
    information[ROLL, ROLL] = alone / (roll * roll)
    information[TILT, ROLL] = information[ROLL, TILT] = -alone * both / (tilt * roll)
    information[TILT_JUMP, TILT_JUMP] = information[ROLL_JUMP, ROLL_JUMP] = 1.0 / (jump * jump)
    return GaussianPrior(mean, information)


def plausible_matches(rays: Rays, prior: Prior) -> BoolArray:
    """Return the matches, (N,), on one side of the horizon, as far as attitude and lens tell."""
    attitude = prior.attitude
    blur = JITTER_SHARE * attitude.jitter
    tilted = 2.0 * (attitude.tilt_deviation + attitude.roll_deviation)
    slack = tilted + INLIER_DEVIATIONS * np.sqrt(rays.noise * rays.noise + blur * blur)
    # Angles may truly be larger, and so is then what a tilt does.
    stretch = float(np.exp(REACH * prior.lens.ratio_deviation))
    return plausible(levelled(rays, attitude.tilt, attitude.roll), stretch * slack)


def levelled(rays: Rays, tilt: Any, roll: Any, tilt_jump: Any = 0.0, roll_jump: Any = 0.0) -> Rays:
    """
    Return ``rays``, (..., N), as upright cameras would see them.

    Angles, shape (...), are those of the desired camera; the current one has the jumps added.
    """
    tilt, roll, tilt_a, roll_a = (
        np.asarray(angle)[..., None] for angle in (tilt, roll, tilt + tilt_jump, roll + roll_jump)
    )
    return Rays(
        *level(rays.x_a, rays.y_a, rays.z_a, tilt_a, roll_a),
        *level(rays.x_d, rays.y_d, rays.z_d, tilt, roll),
        rays.noise_a,
        rays.noise_d,
    )


def conclude(rays: Rays, agree: BoolArray, after: Posterior, prior: Prior) -> Estimate:
    """Return the estimate by matches that ``agree``, (N,)."""
    phasors = phasors_of(after.parameters)
    desired, current = cameras(phasors)
    vote, inliers = in_front_of(rays, agree, after.parameters)
    balance = float(vote)
    psi, phi, tilt, tilt_jump, roll, roll_jump = after.parameters.tolist()
    attitude = Attitude(tilt, roll, jitter=prior.attitude.jitter)
    return Estimate(
        oriented(psi, phi, balance),
        desired.T @ fundamentals(phasors[: PHI + 1], vote) @ current,
        inliers,
        min(abs(balance), 1.0),
        after.covariance[: PHI + 1, : PHI + 1],
        attitude=attitude.known_to(after.covariance[BOTH, BOTH]),
        jump=math.hypot(tilt_jump, roll_jump),
    )


def in_front_of(rays: Rays, agree: BoolArray, angles: FloatArray) -> tuple[FloatArray, BoolArray]:
    """Return the vote of matches in front of the cameras, (...), and which they are, (..., N)."""
    upright = levelled(
        rays, angles[..., TILT], angles[..., ROLL], angles[..., TILT_JUMP], angles[..., ROLL_JUMP]
    )
    inliers = agree & plausible(upright, INLIER_DEVIATIONS * rays.noise)
    return balances_in_front(np.exp(1j * angles[..., : PHI + 1]), upright, inliers)


def exchanged_on_plane(rays: Rays, fit: Fit) -> FloatArray | None:
    """
    Return where the other geometry of a plane is looked for, (6,); see ``exchanged_bearings``.

    The plane is the one that fits the ``rays`` which agree with a ``fit`` best.
    """
    psi, phi, tilt, tilt_jump, roll, roll_jump = fit.parameters.tolist()
    upright = levelled(rays, tilt, roll, tilt_jump, roll_jump)
    agree = fit.squared <= INLIER_DEVIATIONS**2
    desired = np.stack([upright.x_d, upright.y_d, upright.z_d], axis=1)[agree]
    current = np.stack([upright.x_a, upright.y_a, upright.z_a], axis=1)[agree]
    turned = current @ rotation_desired_current(psi - phi - HALF_PI).T
    place = np.array([math.cos(psi), 0.0, math.sin(psi)])
    # The ray turned is along d - p (m . d), so (r x p) (m . d) = r x d.
    across = np.cross(turned, place)
    size = np.sqrt((across * across).sum(axis=1)) + TINY
    along = (np.cross(turned, desired) * across).sum(axis=1) / size
    plane = np.linalg.lstsq(size[:, None] * desired, along, rcond=None)[0]
    view = np.array([place[0], place[2], psi - phi - HALF_PI])
    bearings = exchanged_bearings(view, plane[[0, 2]])
    if bearings is None:
        return None
    start = fit.parameters.copy()
    start[: PHI + 1] = bearings.psi, bearings.phi
    return start
