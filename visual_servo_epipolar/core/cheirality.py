"""
Which way the baseline points: scene points lie in front of both cameras.

The epipolar constraint holds for a baseline and its reverse alike; only depths tell them apart.
"""

from dataclasses import dataclass
import math

import numpy as np

from visual_servo_epipolar.core.arrays import FloatArray
from visual_servo_epipolar.core.epipolar import Bearings, epipoles
from visual_servo_epipolar.core.errors import DegenerateGeometryError
from visual_servo_epipolar.core.motion import wrap_angle

VOTE_SATURATION = 3.0


@dataclass(frozen=True, slots=True)
class Vote:
    """Outcome of the cheirality vote: the oriented bearings, and by how much they won."""

    bearings: Bearings
    confidence: float  # 0 (tie) .. 1 (unanimous)


def oriented_bearings(
    fundamental: FloatArray, current: FloatArray, desired: FloatArray, *, noise: float
) -> Vote:
    """
    Return the bearings of F at unit focal length, oriented by the matches.

    Parameters
    ----------
    fundamental : array, shape (3, 3)
        F for rays; the small out-of-plane part that noise gives its epipoles is dropped.
    current, desired : arrays, shape (N, 2)
        Inlying matches as rays.
    noise : float
        Standard deviation of a ray coordinate (pixel noise over focal length).

    Raises
    ------
    DegenerateGeometryError
        If an epipole is not in the plane of motion at all, or F is of rank 1.

    """
    e_current, e_desired = epipoles(fundamental)
    if min(abs(e_current[1]), abs(e_desired[1])) > 0.7:
        raise DegenerateGeometryError(
            f'epipoles must lie in the plane of motion, got {e_current} and {e_desired}; '
            'the matches do not come from a planar motion'
        )
    psi = math.atan2(e_desired[2], e_desired[0])
    # The goal centre in current axes is (sin phi, -cos phi) in (x, z), up to its sign.
    phi = math.atan2(e_current[0], -e_current[2])
    bearings = _relative_sign(Bearings(psi, phi), current, desired)
    return cheirality(bearings, current, desired, noise=noise)


def _relative_sign(bearings: Bearings, current: FloatArray, desired: FloatArray) -> Bearings:
    """Turn phi by pi if the matches say so: in planar motion v_a and v_d have the same sign."""
    first = math.cos(bearings.psi) - math.sin(bearings.psi) * desired[:, 0]
    second = math.cos(bearings.phi) * current[:, 0] + math.sin(bearings.phi)
    # v_a first + v_d second = 0 with v_a v_d > 0: the product is negative for every match.
    agreement = np.clip(first * second, -0.05, 0.05)
    if float(agreement.sum()) > 0.0:
        return Bearings(bearings.psi, wrap_angle(bearings.phi + math.pi))
    return bearings


def cheirality(
    bearings: Bearings, current: FloatArray, desired: FloatArray, *, noise: float
) -> Vote:
    """
    Choose between ``bearings`` and their reverse: scene points lie in front of both cameras.

    The epipolar constraint holds for both signs of the baseline; the parallax that is left once
    the rotation is compensated does not. Each match votes with the sign of its two depths,
    weighted by its parallax angle over ``noise``, squared and saturated at three, so that an
    outlier counts no more than a good match. With too little parallax the confidence is near zero.
    """
    alpha = bearings.heading_error
    cosine, sine = math.cos(alpha), math.sin(alpha)
    turned_x = cosine * current[:, 0] - sine
    turned_z = sine * current[:, 0] + cosine
    cross = desired[:, 0] * turned_z - turned_x  # h_d x h_r
    c_x, c_z = math.cos(bearings.psi), math.sin(bearings.psi)
    depth_current = -cross * (desired[:, 0] * c_z - c_x)
    depth_desired = -cross * (turned_x * c_z - turned_z * c_x)
    parallax = np.abs(cross) / np.sqrt((1.0 + desired[:, 0] ** 2) * (turned_x**2 + turned_z**2))
    weight = np.minimum(parallax / noise, VOTE_SATURATION) ** 2
    score = float((weight * (np.sign(depth_current) + np.sign(depth_desired))).sum())
    total = 2.0 * VOTE_SATURATION**2 * max(len(current), 1)
    return Vote(bearings if score >= 0.0 else bearings.reversed(), min(abs(score) / total, 1.0))
