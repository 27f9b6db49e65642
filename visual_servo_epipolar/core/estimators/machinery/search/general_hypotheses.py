"""
Hypotheses for a camera mounted any way: general ones, and the planar motions nearest to them.

Five matches give an essential matrix without any vertical. In a planar motion the vertical n of
the desired camera is across the baseline and is the axis of the rotation: n . t = 0, R n = n. What
a pair leaves open, as a pure translation does, the prior of the attitude closes.
"""

import numpy as np

from visual_servo_epipolar.core.arrays import FloatArray, packed
from visual_servo_epipolar.core.estimators.base import Attitude
from visual_servo_epipolar.core.estimators.machinery.hypotheses import (
    best_modes,
    INLIER_DEVIATIONS,
    Rays,
    SEPARATION,
)
from visual_servo_epipolar.core.estimators.machinery.planar import undetermined
from visual_servo_epipolar.core.estimators.machinery.sampson import squared_distances, table_of
from visual_servo_epipolar.core.estimators.machinery.search.five_point import (
    essential_matrices,
    samples,
)
from visual_servo_epipolar.core.estimators.machinery.tilted_planar import (
    matrices,
    PHI,
    PSI,
    ROLL,
    TILT,
)
from visual_servo_epipolar.core.geometry.motion import HALF_PI
from visual_servo_epipolar.core.geometry.rays import rotation_level_camera

SAMPLES = 160  # where 40 % of the matches are wrong, a dozen samples have none
BEST = 60  # essential matrices that are made planar
MODES = 8
PLANARITY = 0.004  # how far a good sample leaves n . t and R n - n from zero
ROUGHNESS = 6.0  # of hypotheses from five noisy matches, in noises
QUARTER_TURN = np.array([[0.0, -1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, 1.0]])


def general_start_parameters(rays: Rays, attitude: Attitude) -> FloatArray:
    """
    Return the best hypotheses of different modes as parameters, shape (K, 6).

    Raises
    ------
    DegenerateGeometryError
        If no five matches determine anything.

    """
    essential = essential_matrices(rays, samples(rays.matches, SAMPLES))
    if not len(essential):
        raise undetermined()
    blur = ROUGHNESS * rays.mean_noise
    table = table_of(rays.blurred(float(blur)))
    order = _costs(essential.reshape(-1, 9), table).argsort(kind='stable')[:BEST]
    starts = planar_parameters(essential[order], attitude)
    costs = _costs(matrices(starts)[:, 0], table)
    modes = np.exp(1j * starts[:, [PSI, PHI]].T)
    return starts[best_modes(modes, costs, MODES, separation=SEPARATION)]


def _costs(rows: FloatArray, table: FloatArray) -> FloatArray:
    """Return the mean truncated squared Sampson distance of E by rows, (K, 9): from 0 to 1."""
    squared = squared_distances(rows, table) / INLIER_DEVIATIONS**2
    return np.asarray(np.minimum(squared, 1.0).mean(axis=1))


def planar_parameters(essential: FloatArray, attitude: Attitude) -> FloatArray:
    """Return the planar motions nearest to ``essential``, shape (K, 3, 3), as (K, 6)."""
    u, _, vt = np.linalg.svd(essential)
    u[..., 2] *= np.sign(np.linalg.det(u))[:, None]
    vt[..., 2, :] *= np.sign(np.linalg.det(vt))[:, None]
    baseline = u[..., 2]
    both = np.stack([u @ QUARTER_TURN @ vt, u @ QUARTER_TURN.T @ vt])
    away = both - np.eye(3)
    spread = baseline[:, :, None] * baseline[:, None] + away.swapaxes(-1, -2) @ away
    values, vectors = np.linalg.eigh(spread / PLANARITY**2 + _prior_form(attitude))
    # One of the two is the other turned by half around the baseline: no vertical is its axis.
    twin = values[..., 0].argmin(axis=0)
    each = np.arange(len(essential))
    vertical, rotation = vectors[twin, each, :, 0], both[twin, each]
    vertical *= np.copysign(1.0, vertical @ _level(attitude)[1])[:, None]
    tilt = np.arcsin(np.clip(vertical[:, 2], -1.0, 1.0))
    roll = np.arctan2(packed(vertical[:, 0]), packed(vertical[:, 1]))
    return _parameters(baseline, rotation, tilt, roll)


def _parameters(
    baseline: FloatArray, rotation: FloatArray, tilt: FloatArray, roll: FloatArray
) -> FloatArray:
    """Return psi, phi, tilt, roll without jumps, shape (K, 6), from t and R in tilted axes."""
    level = np.array([rotation_level_camera(*each) for each in zip(tilt, roll, strict=True)])
    upright = (level @ baseline[..., None])[..., 0]
    turn = level @ rotation @ level.swapaxes(-1, -2)
    heading = np.arctan2(turn[:, 2, 0] - turn[:, 0, 2], turn[:, 0, 0] + turn[:, 2, 2])
    start = np.zeros((len(tilt), 6))
    start[:, PSI] = np.arctan2(packed(upright[:, 2]), packed(upright[:, 0]))
    start[:, PHI] = start[:, PSI] - heading - HALF_PI
    start[:, TILT], start[:, ROLL] = tilt, roll
    return start


def _level(attitude: Attitude) -> FloatArray:
    return rotation_level_camera(attitude.tilt, attitude.roll)


def _prior_form(attitude: Attitude) -> FloatArray:
    """Return the quadratic form of a vertical, shape (3, 3), that the prior of attitude is."""
    right, _, forward = _level(attitude)
    by_roll = np.outer(right, right) / attitude.roll_deviation**2
    return np.asarray(by_roll + np.outer(forward, forward) / attitude.tilt_deviation**2)
