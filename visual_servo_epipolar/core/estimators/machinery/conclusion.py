"""What is concluded from refined parameters: inliers, the vote on the sign, F."""

from collections.abc import Callable
from typing import NamedTuple

import numpy as np

from visual_servo_epipolar.core.arrays import BoolArray, ComplexArray, FloatArray
from visual_servo_epipolar.core.estimators.base import Estimate
from visual_servo_epipolar.core.estimators.machinery.gaussian import undetermined
from visual_servo_epipolar.core.estimators.machinery.hypotheses import INLIER_DEVIATIONS, Rays
from visual_servo_epipolar.core.estimators.machinery.refinement import Fit
from visual_servo_epipolar.core.geometry.cheirality import AHEAD_SHARE, balances_ahead

REFITS = 3  # without matches that lie behind a camera
DEPTH_DEVIATIONS = 3.0  # of parallax, and of the way to the epipole: a depth has its sign then


class Conclusion(NamedTuple):
    """
    Geometries of pairs of views: parameters, (..., P), and their covariance, (..., P, P).

    ``determined``, (...), says where the matches fix the bearings; ``inliers``, (..., N), agree
    with them; ``balance``, (...), of the cheirality vote is negative where psi and phi are those
    of the reverse baseline; ``fundamental``, (..., 3, 3), has the sign of the vote.
    """

    parameters: FloatArray
    covariance: FloatArray
    determined: BoolArray
    inliers: BoolArray
    balance: FloatArray
    fundamental: FloatArray

    def require_determined(self) -> None:
        """Raise DegenerateGeometryError where one geometry is not determined."""
        if not self.determined:
            raise undetermined()


def estimate_in_front(
    matches: BoolArray,
    fit: Fit,
    conclude: Callable[[BoolArray, Fit], Estimate],
    refine: Callable[[BoolArray, FloatArray], Fit],
) -> Estimate:
    """
    Return what ``conclude`` says of the ``matches``, (N,), refined without those behind a camera.

    They agree by chance; an epipole that lies on one of them is fixed by nothing else.
    """
    estimate = conclude(matches, fit)
    for _ in range(REFITS):
        behind = matches & (fit.squared <= INLIER_DEVIATIONS**2) & ~estimate.inliers
        if not behind.any():
            break
        matches = matches & ~behind
        fit = refine(matches, fit.parameters)
        estimate = conclude(matches, fit)
    return estimate


def balances_in_front(
    bearings: ComplexArray, upright: Rays, voting: BoolArray
) -> tuple[FloatArray, BoolArray]:
    """
    Return the balance of the matches that lie in front, (...), and which of the voting: (..., N).

    ``bearings`` are exp(i psi) and exp(i phi), shape (..., 2). Where more than a few have a depth
    of the wrong sign, the geometry is in doubt, not they.
    """
    planes = (upright.x_a, upright.z_a), (upright.x_d, upright.z_d)
    balance, ahead = balances_ahead(bearings, *planes, voting, upright.noise)
    in_front = ahead & ~_behind(bearings, upright, balance)
    kept = in_front.sum(axis=-1) >= AHEAD_SHARE * voting.sum(axis=-1)
    return balance, np.where(kept[..., None], in_front, ahead)


def _behind(bearings: ComplexArray, upright: Rays, balance: FloatArray) -> BoolArray:
    """
    Return which matches, (..., N), lie along the reverse of a ray, by more than noise.

    On its epipolar line a match is displaced away from the epipole ahead. An epipole that comes to
    lie between the two images of a wrong match, or upon one of them, would be fixed by it alone.
    """
    psi, phi = bearings[..., :1], bearings[..., 1:]
    desired = psi.conj() * (upright.x_d + 1j * upright.z_d)
    current = 1j * phi.conj() * (upright.x_a + 1j * upright.z_a)
    # Along the baseline, and across it: y is the other direction across.
    along_d, along_a = desired.real, -current.real
    sine_d = np.sqrt(desired.imag * desired.imag + upright.y_d * upright.y_d)
    sine_a = np.sqrt(current.imag * current.imag + upright.y_a * upright.y_a)
    both = upright.y_d * upright.y_a - desired.imag * current.imag
    noise = upright.noise
    least = DEPTH_DEVIATIONS * noise
    # Sine of the parallax as each ray has it, less where it is near the epipole.
    seen_d = (along_a * sine_d * sine_d - along_d * both) / np.hypot(sine_d, least)
    seen_a = (along_a * both - along_d * sine_a * sine_a) / np.hypot(sine_a, least)
    sign = np.where(balance < 0.0, -1.0, 1.0)[..., None]
    return np.asarray(np.maximum(sign * seen_d, sign * seen_a) > 1.4142 * least)
