"""
The soft planar estimator for a camera that nobody calibrated: focal length and principal point.

Rays made with a wrong camera matrix are p' = A^-1 p, A = [[r, 0, h], [0, r, 0], [0, 0, 1]], with r
the focal length that was told over the true one, and h the shift of the principal point along u.
That along v acts as a tilt. So E becomes A^T E A: with D = diag(r, r, 1) and B = D^-1 A, each
element by r to the power of 2, 1 or 0, then h / r times the first row and column to the last ones.
"""

from collections.abc import Sequence
from dataclasses import replace
import math

import numpy as np

from visual_servo_epipolar.core.arrays import BoolArray, FloatArray
from visual_servo_epipolar.core.estimators.base import Estimate, Prior
from visual_servo_epipolar.core.estimators.machinery.attitude import attitudes_of
from visual_servo_epipolar.core.estimators.machinery.batch import (
    Answer,
    answers,
    Method,
    Views,
    views_of,
)
from visual_servo_epipolar.core.estimators.machinery.hypotheses import (
    fused,
    INLIER_DEVIATIONS,
    Rays,
)
from visual_servo_epipolar.core.estimators.machinery.refinement import (
    Belief,
    Fit,
    followed,
    NEGLIGIBLE,
    problem,
    refined,
)
from visual_servo_epipolar.core.estimators.machinery.sampson import table_of
from visual_servo_epipolar.core.estimators.machinery.tilted_planar import (
    matrices,
    PHI,
    PSI,
    ROLL,
    TILT,
)
from visual_servo_epipolar.core.estimators.soft_planar import (
    belief_of,
    candidates,
    concluded,
    Fused,
    kept,
    MIN_MATCHES,
    searched,
)
from visual_servo_epipolar.core.geometry.epipolar import Bearings
from visual_servo_epipolar.core.geometry.lens import for_wrong_rays, Lens

# Places among the parameters: log r, the rest of h, and k, which is known. What is known before of
# log r and h is correlated; of log r and h - k log r it is not.
RATIO, REST, TIE = 6, 7, 8
KNOWN = 1e12  # information of what does not move
POWERS = np.array([2.0, 2.0, 1.0, 2.0, 2.0, 1.0, 1.0, 1.0, 0.0])  # of r, by rows
STEP = 0.25  # between the focal lengths that are tried: of their logarithm
ROUGHNESS = 3.0  # of hypotheses with a focal length between two that are tried, in noises
REACH = 2.0  # how far they reach, in deviations of the prior


def soft_uncalibrated_each(
    current: FloatArray, desired: FloatArray, *, noise: FloatArray, priors: Sequence[Prior]
) -> list[Answer]:
    """Do as ``soft_planar_each`` does, and estimate the camera matrix too."""
    return answers(views_of(current, desired, noise, priors), METHOD)


def model(parameters: FloatArray) -> FloatArray:
    """Return A^T E A and its derivatives by ``parameters``, shape (K, 9), as rows: (K, 10, 9)."""
    log_ratio, rest, shift_slope = parameters[:, RATIO:, None, None].swapaxes(0, 1)
    ratio, shift = np.exp(log_ratio), rest + shift_slope * log_ratio
    made = np.zeros((len(parameters), 10, 9))
    made[:, : RATIO + 1] = matrices(parameters[:, :RATIO])
    made[:, RATIO + 1] = made[:, 0] * POWERS
    made[:, : RATIO + 2] *= ratio**POWERS
    solid = made.reshape(-1, 10, 3, 3)
    scaled = solid[:, : RATIO + 2]
    scaled[..., 2] += shift / ratio * scaled[..., 0]
    scaled[:, :, 2] += shift / ratio * scaled[:, :, 0]
    by_shift = solid[:, REST + 1]
    by_shift[:, :, 2] = solid[:, 0, :, 0]
    by_shift[:, 2] += solid[:, 0, 0]
    by_shift /= ratio
    solid[:, RATIO + 1] += (shift_slope - shift) * by_shift
    return made


def _belief(priors: Sequence[Prior]) -> Belief:
    mean, information = belief_of(attitudes_of(priors))
    lens = np.array([prior.lens.known for prior in priors])
    known = np.zeros((len(priors), 3))
    known[:, 2] = lens[:, 2]
    lens[:, :2] **= -2.0
    lens[:, 2] = KNOWN
    return Belief(np.hstack([mean, known]), np.hstack([information, lens]))


def _keep(views: Views) -> BoolArray:
    return kept(views, np.exp([[REACH * p.lens.ratio_deviation] for p in views.priors]))


def _follow(views: Views, possible: BoolArray) -> Fit:
    belief = _belief(views.priors)
    start = belief.mean.copy()
    start[:, [PSI, PHI]] = views.before
    jitter = attitudes_of(views.priors).jitter[:, 0]
    return followed(
        start,
        problem(model, table_of(views.rays, views.noise, possible), belief),
        negligible=NEGLIGIBLE * views.noise,
        scale=np.maximum(1.0, 0.7 * jitter / views.noise),
    )


def _search(rays: Rays, noise: float, prior: Prior) -> tuple[Fit, int, Bearings | None]:
    return searched(lambda jumps: _solutions(rays, noise, prior, jumps), prior, rays)


def _solutions(rays: Rays, noise: float, prior: Prior, jumps: FloatArray) -> Fit:
    belief = _belief([prior])
    belief = Belief(belief.mean[0], belief.information[0])
    steps = math.ceil(REACH * prior.lens.ratio_deviation / STEP)
    tried = [_candidates(rays, noise, prior, jumps, STEP * k) for k in range(-steps, steps + 1)]
    if prior.bearings is not None:
        last = belief.mean.copy()
        last[[PSI, PHI]] = prior.bearings.psi, prior.bearings.phi
        tried.append(last[None])
    return refined(
        np.vstack(tried),
        problem(model, table_of(rays, noise), belief),
        negligible=NEGLIGIBLE * noise,
        scale=max(ROUGHNESS, 0.7 * prior.attitude.jitter / noise),
    )


def _candidates(
    rays: Rays, noise: float, prior: Prior, jumps: FloatArray, log_ratio: float
) -> FloatArray:
    """Return candidates with one focal length, shape (K, 9)."""
    ratio, shift_slope = math.exp(log_ratio), prior.lens.shift_slope
    shift = shift_slope * log_ratio
    u_a, v_a, u_d, v_d = (ratio * part for part in rays)
    found = candidates(
        Rays(u_a + shift, v_a, u_d + shift, v_d), ratio * noise, prior.attitude, jumps
    )
    return np.hstack([found, np.tile([log_ratio, 0.0, shift_slope], (len(found), 1))])


def _conclude(
    views: Views, possible: BoolArray, fit: Fit, rivals: Sequence[Bearings | None]
) -> list[Answer]:
    covariance = fit.covariance()
    found, determined = fused(fit.parameters, covariance, views.before, views.deviation)
    log_ratio, rest, shift_slope = found[:, RATIO:].T
    ratio, shift = np.exp(log_ratio), rest + shift_slope * log_ratio
    u_a, v_a, u_d, v_d = (ratio[:, None] * part for part in views.rays)
    rays = Rays(u_a + shift[:, None], v_a, u_d + shift[:, None], v_d)
    given = np.asarray(np.linalg.inv(fit.information[:, :RATIO, :RATIO]), dtype=np.float64)
    made = concluded(
        views._replace(rays=rays, noise=ratio * views.noise),
        possible & (fit.squared <= INLIER_DEVIATIONS**2),
        Fused(found[:, :RATIO], given, determined),
        rivals,
    )
    lenses = map(_lens, log_ratio.tolist(), shift.tolist(), shift_slope, covariance)
    spare = covariance[:, :RATIO, :RATIO] - given
    return [_with_lens(*row) for row in zip(made, lenses, spare, strict=True)]


def _lens(log_ratio: float, shift: float, shift_slope: float, covariance: FloatArray) -> Lens:
    """Return the lens found, with its part of the ``covariance`` of the parameters, (9, 9)."""
    to_lens = np.array([[1.0, 0.0], [shift_slope, 1.0]])  # h is the rest and k log r
    return Lens.of(log_ratio, shift, to_lens @ covariance[RATIO:TIE, RATIO:TIE] @ to_lens.T)


def _with_lens(answer: Answer, lens: Lens, spare: FloatArray) -> Answer:
    """Return the estimate with its lens, and what not knowing it adds to covariances, (6, 6)."""
    if not isinstance(answer, Estimate) or answer.attitude is None:
        return answer
    attitude = answer.attitude
    return replace(
        answer,
        lens=lens,
        lens_covariance=spare[: PHI + 1, : PHI + 1],
        fundamental=for_wrong_rays(answer.fundamental, lens),
        attitude=replace(
            attitude,
            tilt_deviation=math.sqrt(attitude.tilt_deviation**2 + spare[TILT, TILT]),
            roll_deviation=math.sqrt(attitude.roll_deviation**2 + spare[ROLL, ROLL]),
        ),
    )


METHOD = Method(MIN_MATCHES, _keep, _follow, _search, _conclude)
