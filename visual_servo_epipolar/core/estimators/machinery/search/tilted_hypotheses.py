"""Hypotheses for a camera that is nearly upright: two-point ones, for several tilts and jumps."""

import math

import numpy as np

from visual_servo_epipolar.core.arrays import FloatArray
from visual_servo_epipolar.core.estimators.base import Attitude
from visual_servo_epipolar.core.estimators.machinery.hypotheses import (
    best_modes,
    Rays,
    scores,
    SEPARATION,
    two_point_hypotheses,
)
from visual_servo_epipolar.core.estimators.machinery.tilted_planar import (
    JITTER_SHARE,
    levelled,
    PHI,
    PSI,
    ROLL,
    TILT,
    TILT_JUMP,
)

COLD = math.radians(0.3)  # above this deviation of the tilt, hypotheses are made for several tilts
GENERAL = math.radians(2.5)  # above it tilts to try would be too many: see ``general_hypotheses``
TILTS = np.linspace(-1.0, 1.0, 9)  # of those, in deviations of the prior
PAIRS = 60  # for each attitude that is tried
MODES = 6
NO_JUMP = np.zeros(1)
JUMPS = np.array([-3.2, -1.6, 0.0, 1.6, 3.2])  # of tilt between the views, in jitters


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
    costs = scores(hypotheses, upright.blurred(JITTER_SHARE * attitude.jitter)).ravel()
    each = hypotheses.shape[-1]
    hypotheses = hypotheses.swapaxes(0, 1).reshape(2, -1)
    best = best_modes(hypotheses, costs, MODES, separation=0.5 * SEPARATION)
    start = np.zeros((len(best), 6))
    start[:, [PSI, PHI]] = np.angle(hypotheses[:, best]).T
    start[:, ROLL] = attitude.roll
    start[:, [TILT, TILT_JUMP]] = grid[best // each]
    return start
