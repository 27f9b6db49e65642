"""
Planar motion as a camera sees it that is not quite upright: E and its derivatives by parameters.

Six parameters are psi, phi, tilt and roll of the desired camera, and what both have changed by
since: E = C_d^T F C_a with C = R_x(tilt) R_z(roll) from camera to level axes. The derivatives by
tilt put the generator S_x beside F, those by roll put S_z beside E; both are linear.

Three more are those of a camera matrix that is wrong. Its rays are along A^-1 p,
A = [[r, 0, h], [0, r, 0], [0, 0, 1]], with r the configured focal length over the true one, and h
the shift of the principal point along u. That along v acts as a tilt. So E becomes A^T E A: with
D = diag(r, r, 1) and B = D^-1 A, each element by r to the power of 2, 1 or 0, then h / r times the
first row and column to the last ones.

What is known beforehand says something of the parameters, and of which matches are plausible.
"""

import math
from typing import Any, NamedTuple

import numpy as np

from visual_servo_epipolar.core.arrays import BoolArray, FloatArray, packed, TINY
from visual_servo_epipolar.core.geometry.cheirality import depth_balance, VOTE_SATURATION
from visual_servo_epipolar.core.geometry.epipolar import rotation_desired_current
from visual_servo_epipolar.core.geometry.lens import corrected, Lens, REACH
from visual_servo_epipolar.core.geometry.motion import HALF_PI
from visual_servo_epipolar.core.geometry.rays import level, rotation_level_camera
from visual_servo_epipolar.core.geometry.rotation import TRUSTED_SHARE
from visual_servo_epipolar.core.geometry.wall import exchanged_bearings
from visual_servo_epipolar.core.twoview.estimator import LEAST_JITTER, Prior
from visual_servo_epipolar.core.twoview.hypotheses import INLIER_DEVIATIONS, Rays, rays_of

# A jump is the current view less the desired one. Of the lens: log r, the rest of h, and k, which
# is known: h = rest + k log r. Priors of log r and h are correlated, those of log r and rest not.
PSI, PHI, TILT, TILT_JUMP, ROLL, ROLL_JUMP, RATIO, REST, SLOPE = range(9)
BOTH = slice(TILT, ROLL + 1, ROLL - TILT)  # tilt and roll
POWERS = np.array([2.0, 2.0, 1.0, 2.0, 2.0, 1.0, 1.0, 1.0, 0.0])  # of r, by rows
KNOWN = 1e12  # information of what does not move
JITTER_DEVIATIONS = 3.0  # a prior tighter than the true jitter does harm

S_X = np.array([[0.0, 0.0, 0.0], [0.0, 0.0, 1.0], [0.0, -1.0, 0.0]])
S_Z = np.array([[0.0, -1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, 0.0]])


class GaussianPrior(NamedTuple):
    """Gaussian prior of P parameters: mean, shape (P,), and information, (P, P)."""

    mean: FloatArray
    information: FloatArray


def matrices(parameters: FloatArray) -> FloatArray:
    """Return E and its derivatives by P ``parameters``, (..., P), as rows: (..., 1 + P, 9)."""
    if parameters.shape[-1] > RATIO:
        return _by_wrong_lens(parameters)
    *leading, _ = parameters.shape
    bearings = np.exp(1j * parameters[..., : PHI + 1])
    psi, phi = bearings[..., 0], bearings[..., 1]
    level = np.zeros((*leading, 5, 3, 3))  # of level cameras: F, by psi, phi, tilt and tilt jump
    level[..., 0, 0, 1], level[..., 0, 2, 1] = -psi.imag, psi.real
    level[..., 0, 1, 0], level[..., 0, 1, 2] = phi.real, phi.imag
    level[..., 1, 0, 1], level[..., 1, 2, 1] = -psi.real, -psi.imag
    level[..., 2, 1, 0], level[..., 2, 1, 2] = -phi.imag, phi.real
    level[..., 4, :, :] = level[..., 0, :, :] @ S_X
    level[..., 3, :, :] = level[..., 4, :, :] - S_X @ level[..., 0, :, :]
    # Of the desired camera, and with the jumps of the current one.
    tilts, rolls = parameters[..., TILT:ROLL].cumsum(-1), parameters[..., ROLL:].cumsum(-1)
    both = rotation_level_camera(tilts, rolls)
    desired, current = both[..., 0, :, :], both[..., 1, :, :]
    stack = np.empty((*leading, 7, 3, 3))
    stack[..., :5, :, :] = (
        desired.swapaxes(-2, -1)[..., None, :, :] @ level @ current[..., None, :, :]
    )
    plain = stack[..., 0, :, :]
    stack[..., 6, :, :] = plain @ S_Z
    stack[..., 5, :, :] = stack[..., 6, :, :] - S_Z @ plain
    return stack.reshape(*leading, 7, 9)


def _by_wrong_lens(parameters: FloatArray) -> FloatArray:
    """Return A^T E A and its derivatives by ``parameters``, (..., 9), as rows: (..., 10, 9)."""
    *leading, _ = parameters.shape
    log_ratio, rest, slope = (parameters[..., k, None, None] for k in (RATIO, REST, SLOPE))
    ratio, shift = np.exp(packed(log_ratio)), rest + slope * log_ratio
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


def known_before(prior: Prior) -> GaussianPrior:
    """Return what is known of the six parameters, or of all nine by a lens that is not known."""
    attitude, lens = prior.attitude, prior.lens
    tilt, roll, both = attitude.tilt_deviation, attitude.roll_deviation, attitude.correlation
    jump = max(JITTER_DEVIATIONS * attitude.jitter, LEAST_JITTER)
    count = RATIO if lens.calibrated else SLOPE + 1
    mean, information = np.zeros(count), np.zeros((count, count))
    mean[TILT], mean[ROLL] = attitude.tilt, attitude.roll
    alone = 1.0 / (1.0 - both * both)
    information[TILT, TILT] = alone / (tilt * tilt)
    information[ROLL, ROLL] = alone / (roll * roll)
    information[TILT, ROLL] = information[ROLL, TILT] = -alone * both / (tilt * roll)
    information[TILT_JUMP, TILT_JUMP] = information[ROLL_JUMP, ROLL_JUMP] = 1.0 / (jump * jump)
    if not lens.calibrated:
        mean[SLOPE], information[SLOPE, SLOPE] = lens.shift_slope, KNOWN
        information[RATIO, RATIO] = 1.0 / (lens.ratio_deviation * lens.ratio_deviation)
        information[REST, REST] = 1.0 / (lens.rest_deviation * lens.rest_deviation)
    return GaussianPrior(mean, information)


def plausible_matches(rays: Rays, prior: Prior) -> BoolArray:
    """Return the matches, (N,), on one side of the horizon, as far as attitude and lens tell."""
    attitude = prior.attitude
    tilted = REACH * (attitude.tilt_deviation + attitude.roll_deviation)
    slack = tilted + INLIER_DEVIATIONS * np.sqrt(rays.noise * rays.noise + attitude.blur**2)
    # Angles may truly be larger, and so is then what a tilt does.
    stretch = float(np.exp(REACH * prior.lens.ratio_deviation))
    return plausible(levelled(rays, attitude.tilt, attitude.roll), stretch * slack)


def plausible(rays: Rays, slack: FloatArray | float) -> BoolArray:
    """Return where y_a and y_d have one sign or are within ``slack`` of the horizon, (..., N)."""
    return np.asarray(rays.y_a * rays.y_d > -slack * slack)


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


def with_lens(rays: Rays, lens: Lens) -> Rays:
    """Return ``rays``, (N,), as a camera with the true matrix has them."""
    (current, growth_a), (desired, growth_d) = (
        corrected(each, lens) for each in (rays.current, rays.desired)
    )
    noise = np.stack([rays.noise_a * growth_a, rays.noise_d * growth_d], axis=-1)
    return rays_of(current, desired, noise)


def in_front_of(rays: Rays, agree: BoolArray, angles: FloatArray) -> tuple[FloatArray, BoolArray]:
    """
    Return the balance of matches in front of the cameras, (...), and which they are, (..., N).

    ``agree``, (..., N), says which matches vote. Where more than a few have a depth of the wrong
    sign, the geometry is in doubt, not they.
    """
    upright = levelled(rays, *(angles[..., k] for k in (TILT, ROLL, TILT_JUMP, ROLL_JUMP)))
    voting = agree & plausible(upright, INLIER_DEVIATIONS * rays.noise)
    phasors = np.exp(1j * angles[..., : PHI + 1])
    planes = (upright.x_a, upright.z_a), (upright.x_d, upright.z_d)
    balance = depth_balance(phasors, *planes, voting, upright.noise)
    # Along the baseline, and across it: y is the other direction across.
    desired = phasors[..., :1].conj() * (upright.x_d + 1j * upright.z_d)
    current = -1j * phasors[..., 1:].conj() * (upright.x_a + 1j * upright.z_a)
    between = (desired * current.conj()).real + upright.y_d * upright.y_a
    sign = np.where(balance < 0.0, -1.0, 1.0)[..., None]
    in_front = voting & ~behind(sign * current.real, sign * desired.real, between, upright.noise)
    kept = in_front.sum(axis=-1) >= TRUSTED_SHARE * voting.sum(axis=-1)
    return balance, np.where(kept[..., None], in_front, voting)


def behind(
    current: FloatArray, desired: FloatArray, between: FloatArray, noise: FloatArray
) -> BoolArray:
    """
    Return which matches, (..., N), lie along the reverse of a ray, by more than noise.

    A match moves along its epipolar line from where it would be at infinity, away from the epipole
    ahead. The other way there is nothing: an epipole that comes to lie between the two images of a
    wrong match, or upon one of them, would be fixed by it alone. Of rays turned alike, cosines are
    those to the way to the ``current`` camera, and ``between`` both; ``noise`` is in rad.
    """
    least = VOTE_SATURATION * noise  # of parallax, and of the way to the epipole
    # Sine of the parallax by each ray, less where it is near the epipole.
    by_desired = (current - desired * between) / np.sqrt(1.0 - desired * desired + least * least)
    by_current = (current * between - desired) / np.sqrt(1.0 - current * current + least * least)
    return np.asarray(np.maximum(by_desired, by_current) > math.sqrt(2.0) * least)


def exchanged_on_plane(rays: Rays, angles: FloatArray) -> FloatArray | None:
    """
    Return where the other geometry of a plane is looked for, (6,); see ``exchanged_bearings``.

    The plane is the one that fits ``rays`` best which agree with the ``angles``, (6,), of one.
    """
    psi, phi, tilt, tilt_jump, roll, roll_jump = angles.tolist()
    upright = levelled(rays, tilt, roll, tilt_jump, roll_jump)
    desired, current = upright.desired, upright.current
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
    start = angles.copy()
    start[: PHI + 1] = bearings.psi, bearings.phi
    return start
