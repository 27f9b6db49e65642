"""
Which way the baseline points: scene points lie along the rays of both cameras, not against them.

The epipolar constraint holds for a baseline and its reverse alike; only depths tell them apart.
"""

from dataclasses import dataclass
import math
from typing import TypeAlias

import numpy as np

from visual_servo_epipolar.core.arrays import BoolArray, ComplexArray, FloatArray, TINY
from visual_servo_epipolar.core.errors import DegenerateGeometryError
from visual_servo_epipolar.core.geometry.epipolar import Bearings, epipoles
from visual_servo_epipolar.core.geometry.motion import wrap_angle

VOTE_SATURATION = 3.0  # deviations beyond which a match counts no more for a sign

Plane: TypeAlias = tuple[FloatArray, FloatArray]  # x and z of rays, shape (..., N) each


@dataclass(frozen=True, slots=True)
class Vote:
    """Outcome of the cheirality vote: the oriented bearings, and by how much they won."""

    bearings: Bearings
    confidence: float  # 0 (tie) .. 1 (unanimous)


def oriented_bearings(
    fundamental: FloatArray,
    current: FloatArray,
    desired: FloatArray,
    *,
    noise: FloatArray | float,
) -> Vote:
    """
    Return the bearings of F at unit focal length, oriented by the matches.

    Parameters
    ----------
    fundamental : array, shape (3, 3)
        F for rays; the small out-of-plane part that noise gives its epipoles is dropped.
    current, desired : arrays, shape (N, 3)
        Inlying matches as unit rays.
    noise : float or array, shape (N,)
        Standard deviation of the angle of a ray [rad].

    Raises DegenerateGeometryError if an epipole is not in the plane of motion at all, or F is of
    rank 1.

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
    """Turn phi by pi if the matches say so: in planar motion y_a and y_d have the same sign."""
    first = math.cos(bearings.psi) * desired[:, 2] - math.sin(bearings.psi) * desired[:, 0]
    second = math.cos(bearings.phi) * current[:, 0] + math.sin(bearings.phi) * current[:, 2]
    # y_a first + y_d second = 0 with y_a y_d > 0: the product is negative for every match.
    agreement = np.clip(first * second, -0.05, 0.05)
    if float(agreement.sum()) > 0.0:
        return Bearings(bearings.psi, wrap_angle(bearings.phi + math.pi))
    return bearings


def cheirality(
    bearings: Bearings, current: FloatArray, desired: FloatArray, *, noise: FloatArray | float
) -> Vote:
    """
    Choose between ``bearings`` and their reverse: scene points lie along their rays.

    The epipolar constraint holds for both signs of the baseline; the parallax that is left once
    the rotation is compensated does not. Each match votes with the sign of its two depths,
    weighted by its parallax angle over ``noise``, squared and saturated at three, so that an
    outlier counts no more than a good match. With too little parallax the confidence is near zero.
    Unit rays have shape (N, 3), ``noise`` [rad] is one number or of shape (N,).
    """
    phasors = np.exp(1j * np.array([bearings.psi, bearings.phi]))
    everyone = np.ones(len(current), bool)
    planes = (current[:, 0], current[:, 2]), (desired[:, 0], desired[:, 2])
    balance = float(depth_balance(phasors, *planes, everyone, np.asarray(noise)))
    return Vote(oriented(bearings.psi, bearings.phi, balance), min(abs(balance), 1.0))


def oriented(psi: float, phi: float, balance: float) -> Bearings:
    """Return the bearings, or their reverse where ``balance`` is negative."""
    bearings = Bearings(psi, phi)
    return bearings.reversed() if balance < 0.0 else bearings


def depth_balance(
    phasors: ComplexArray, current: Plane, desired: Plane, voting: BoolArray, noise: FloatArray
) -> FloatArray:
    """
    Return by how much depths speak for bearings, 1, or for their reverse, -1: shape (...).

    ``phasors`` are exp(i psi) and exp(i phi), shape (..., 2); rays of upright cameras are given by
    x and z; ``voting``, shape (..., N), says which match votes, ``noise``, (..., N), is the
    deviation of their angles [rad].
    """
    (x_a, z_a), (x_d, z_d) = current, desired
    psi = phasors[..., :1]
    turn = psi * phasors[..., 1:].conj()  # exp(i (alpha + pi / 2))
    cosine, sine = turn.imag, -turn.real
    turned_x = cosine * x_a - sine * z_a
    turned_z = sine * x_a + cosine * z_a
    cross = x_d * turned_z - turned_x * z_d  # h_d x h_r
    depth_current = cross * (psi.real * z_d - x_d * psi.imag)
    depth_desired = cross * (turned_z * psi.real - turned_x * psi.imag)
    # cross is the parallax angle times the sines of both rays to the axis of rotation.
    size = np.sqrt((x_d * x_d + z_d * z_d) * (x_a * x_a + z_a * z_a)) + TINY
    weight = cross * cross / (size * (noise * noise))
    np.minimum(weight, VOTE_SATURATION**2, out=weight)
    votes = weight * (np.sign(depth_current) + np.sign(depth_desired))
    total = 2.0 * VOTE_SATURATION**2 * np.maximum(voting.sum(axis=-1), 1)
    return np.asarray((votes * voting).sum(axis=-1) / total)
