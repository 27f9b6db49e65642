"""What the attitude known before says of parameters, and of which matches are plausible."""

from typing import Any

import numpy as np

from visual_servo_epipolar.core.arrays import BoolArray
from visual_servo_epipolar.core.estimators.base import Attitude
from visual_servo_epipolar.core.estimators.machinery.gaussian import GaussianPrior
from visual_servo_epipolar.core.estimators.machinery.hypotheses import (
    INLIER_DEVIATIONS,
    plausible,
    Rays,
)
from visual_servo_epipolar.core.estimators.machinery.tilted_planar import (
    ROLL,
    ROLL_JUMP,
    TILT,
    TILT_JUMP,
)
from visual_servo_epipolar.core.geometry.rays import level

JITTER_DEVIATIONS = 3.0  # a prior tighter than the true jitter does harm
LEAST_JITTER = 1e-4  # [rad]
JITTER_SHARE = 0.7  # of the jitter that shows as noise where jumps are not estimated


def attitude_prior(attitude: Attitude) -> GaussianPrior:
    """Return what is known of psi, phi, tilt, roll and their jumps, of six parameters."""
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


def plausible_matches(rays: Rays, attitude: Attitude, stretch: float = 1.0) -> BoolArray:
    """
    Return the matches, (N,), on one side of the horizon, as far as the attitude is known.

    Angles may truly be larger by ``stretch``, and so is then what a tilt does.
    """
    blur = JITTER_SHARE * attitude.jitter
    tilted = 2.0 * (attitude.tilt_deviation + attitude.roll_deviation)
    slack = tilted + INLIER_DEVIATIONS * np.sqrt(rays.noise * rays.noise + blur * blur)
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
