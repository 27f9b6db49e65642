"""
Shared by planar estimators: a fit from the last bearings, and the estimate made of it.

A model has P parameters, psi and phi first.
"""

from collections.abc import Callable
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from visual_servo_epipolar.core.arrays import BoolArray, ComplexArray, FloatArray
from visual_servo_epipolar.core.errors import DegenerateGeometryError
from visual_servo_epipolar.core.geometry.cheirality import AHEAD_SHARE, balances_ahead
from visual_servo_epipolar.core.geometry.epipolar import MOTION_PARAMETERS
from visual_servo_epipolar.core.geometry.motion import HALF_PI
from visual_servo_epipolar.core.geometry.rays import Axes, tangents
from visual_servo_epipolar.core.twoview.estimator import Estimate, Prior
from visual_servo_epipolar.core.twoview.hypotheses import INLIER_DEVIATIONS, Rays
from visual_servo_epipolar.core.twoview.refinement import (
    Fit,
    GaussianPrior,
    Model,
    Problem,
    problem_of,
    refined,
)

GOOD_COST = 1.8  # of a match, in squared deviations: noise, and outliers fewer than one in six
UNDETERMINED = 1.0  # deviation of a bearing above which the matches say nothing of it [rad]
JITTER_SHARE = 0.7  # of the jitter that shows as noise where jumps are not estimated
REFITS = 3  # without matches that lie behind a camera
DEPTH_DEVIATIONS = 3.0  # of parallax, and of the way to the epipole: a depth has its sign then


class Posterior(NamedTuple):
    """Parameters, (P,), drawn to the last bearings; what the matches alone say of them, (P, P)."""

    parameters: FloatArray
    covariance: FloatArray
    information: FloatArray


@dataclass(frozen=True, slots=True)
class PlanarModel:
    """
    What is an estimator's own: E by its parameters, and what is known of them before.

    ``conclude`` makes an estimate of rays, of the matches that agree, (N,), of the posterior and
    the prior; noise moves rays along ``axes``.
    """

    matrices: Model
    prior_of: Callable[[Prior], GaussianPrior]
    conclude: Callable[[Rays, BoolArray, Posterior, Prior], Estimate]
    axes: Callable[..., Axes] = tangents

    def problem(self, rays: Rays, prior: Prior, matches: BoolArray | None = None) -> Problem:
        """Return what is minimised to fit the model to ``matches``, (N,), or to all."""
        return problem_of(self.matrices, self.prior_of(prior), rays, matches, self.axes)


def widening(rays: Rays, prior: Prior) -> float:
    """Return how much larger than the noise residuals are before jumps are estimated."""
    return float(np.maximum(1.0, JITTER_SHARE * prior.attitude.jitter / rays.mean_noise))


def with_bearings(mean: FloatArray, prior: Prior) -> FloatArray:
    """Return parameters, shape (P,), at their ``mean`` but at the last psi and phi."""
    start = mean.copy()
    start[:2] = prior.angles
    return start


def from_last_bearings(
    model: PlanarModel, rays: Rays, matches: BoolArray, prior: Prior
) -> Estimate | None:
    """Return the estimate by the last bearings where they explain the plausible ``matches``."""
    count = int(matches.sum())
    if prior.bearings is None or count < MOTION_PARAMETERS:
        return None
    problem = model.problem(rays, prior, matches)
    start = with_bearings(problem.prior.mean, prior)
    fit = refined(start, problem, widening(rays, prior))
    change = np.abs(fit.parameters[:2] - prior.angles).max()
    if not (fit.costs <= GOOD_COST * count and change < prior.deviation):
        return None
    return concluded(model, rays, matches, fit, prior)


def concluded(
    model: PlanarModel, rays: Rays, matches: BoolArray, fit: Fit, prior: Prior
) -> Estimate:
    """
    Return the estimate by a ``fit`` to ``matches``, (N,), refined without those behind a camera.

    They agree by chance; an epipole that lies on one of them is fixed by nothing else.
    """
    agree = matches & (fit.squared <= INLIER_DEVIATIONS**2)
    estimate = model.conclude(rays, agree, _posterior(fit, prior), prior)
    for _ in range(REFITS):
        behind = agree & ~estimate.inliers
        if not behind.any():
            break
        matches = matches & ~behind
        fit = refined(fit.parameters, model.problem(rays, prior, matches))
        agree = matches & (fit.squared <= INLIER_DEVIATIONS**2)
        estimate = model.conclude(rays, agree, _posterior(fit, prior), prior)
    return estimate


def _posterior(fit: Fit, prior: Prior) -> Posterior:
    """
    Draw parameters to the last bearings by as much as the matches leave open.

    Where they fix the bearings this changes nothing, where a plane nearly hides them it helps.
    """
    parameters, covariance = fit.parameters, fit.covariance()
    require_determined(covariance)
    if prior.bearings is not None:
        change = np.remainder(prior.angles - parameters[:2] + HALF_PI, np.pi) - HALF_PI
        # (covariance + deviation^2 I)^-1 change, by the adjugate
        own = covariance.diagonal()[:2] + prior.deviation * prior.deviation
        both = covariance[0, 1]
        pull = own[::-1] * change - both * change[::-1]
        pull /= own[0] * own[1] - both * both
        parameters = parameters + (covariance[:, :2] @ pull[:, None])[:, 0]
    return Posterior(parameters, covariance, fit.information)


def require_determined(covariance: FloatArray) -> None:
    """Raise DegenerateGeometryError where the matches do not fix psi and phi."""
    variances = covariance.diagonal()
    if not (variances.min() > 0.0 and variances[:2].max() < UNDETERMINED**2):
        raise undetermined()


def undetermined() -> DegenerateGeometryError:
    """Return what is raised where the matches leave a bearing open altogether."""
    return DegenerateGeometryError(
        'the matches leave the bearings open: there is no baseline, or all of them lie on the '
        "horizon or on one line; track features above and below the camera's height"
    )


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
    # Sine of the parallax by each ray, less where it is near the epipole.
    seen_d = (along_a * sine_d * sine_d - along_d * both) / np.hypot(sine_d, least)
    seen_a = (along_a * both - along_d * sine_a * sine_a) / np.hypot(sine_a, least)
    sign = np.where(balance < 0.0, -1.0, 1.0)[..., None]
    return np.asarray(np.maximum(sign * seen_d, sign * seen_a) > 1.4142 * least)
