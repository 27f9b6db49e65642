"""
The planar estimators for many pairs of views at once, as sweeps have them.

Unit rays have shape (B, N, 3), noise (B,) or (B, N, 2); an error is an answer, too. To read how an
estimator works, read its own file: here are the steps of it that stacks of views share.
"""

from collections.abc import Sequence

import numpy as np

from visual_servo_epipolar.core.arrays import BoolArray, FloatArray
from visual_servo_epipolar.core.estimators import planar_2dof as two
from visual_servo_epipolar.core.estimators import soft_planar as soft
from visual_servo_epipolar.core.estimators import soft_uncalibrated as uncalibrated
from visual_servo_epipolar.core.estimators.base import Prior
from visual_servo_epipolar.core.estimators.machinery import wrong_lens
from visual_servo_epipolar.core.estimators.machinery.attitude_prior import (
    attitude_prior,
    attitudes_of,
    plausible_matches,
)
from visual_servo_epipolar.core.estimators.machinery.batch import (
    Answer,
    answer_of,
    answers,
    BatchMethod,
    refined_each,
    Views,
    views_of,
)
from visual_servo_epipolar.core.estimators.machinery.gaussian import (
    GaussianPrior,
    Posterior,
    posterior,
)
from visual_servo_epipolar.core.estimators.machinery.hypotheses import (
    INLIER_DEVIATIONS,
    plausible,
)
from visual_servo_epipolar.core.estimators.machinery.refinement import (
    Fit,
    Model,
    NEGLIGIBLE,
    problem_of,
)
from visual_servo_epipolar.core.estimators.machinery.sampson import table_of
from visual_servo_epipolar.core.estimators.machinery.tilted_planar import matrices
from visual_servo_epipolar.core.geometry.rays import image_axes


def planar_2dof_each(
    current: FloatArray, desired: FloatArray, *, noise: FloatArray, priors: Sequence[Prior]
) -> list[Answer]:
    """Return what ``planar_2dof`` gives for each of many pairs of views."""
    return answers(views_of(current, desired, noise, priors), PLANAR_2DOF)


def soft_planar_each(
    current: FloatArray, desired: FloatArray, *, noise: FloatArray, priors: Sequence[Prior]
) -> list[Answer]:
    """Return what ``soft_planar`` gives for each of many pairs of views."""
    return answers(views_of(current, desired, noise, priors), SOFT_PLANAR)


def soft_uncalibrated_each(
    current: FloatArray, desired: FloatArray, *, noise: FloatArray, priors: Sequence[Prior]
) -> list[Answer]:
    """Return what ``soft_uncalibrated`` gives for each of many pairs of views."""
    return answers(views_of(current, desired, noise, priors), SOFT_UNCALIBRATED)


def _refined(
    views: Views, table: FloatArray, model: Model, before: GaussianPrior, scale: FloatArray
) -> Fit:
    """Return the fits from the last bearings, (B,)."""
    return refined_each(
        soft.with_bearings(before.mean, views.angles),
        problem_of(model, table, before),
        negligible=NEGLIGIBLE * views.rays.mean_noise,
        scale=scale,
    )


def _posterior(views: Views, fit: Fit) -> Posterior:
    return posterior(fit.parameters, fit.covariance(), views.angles, views.deviation)


def _widening(views: Views) -> FloatArray:
    return soft.widening(attitudes_of(views.priors).jitter, views.rays)


def _plausible_2dof(views: Views) -> BoolArray:
    return plausible(views.rays, INLIER_DEVIATIONS * views.rays.noise)


def _refine_2dof(views: Views, matches: BoolArray) -> Fit:
    mean = np.zeros(views.angles.shape)
    before = GaussianPrior(mean, np.zeros((len(mean), 2, 2)))
    return _refined(
        views, table_of(views.rays, matches), two.model, before, np.ones(len(views.priors))
    )


def _estimates_2dof(views: Views, matches: BoolArray, fit: Fit) -> list[Answer]:
    agree = matches & (fit.squared <= INLIER_DEVIATIONS**2)
    stack = two.conclude(views.rays, agree, _posterior(views, fit))
    return [answer_of(two.estimate_of, row) for row in stack.rows()]


def _plausible_soft(views: Views) -> BoolArray:
    return plausible_matches(views.rays, attitudes_of(views.priors))


def _refine_soft(views: Views, matches: BoolArray) -> Fit:
    before = attitude_prior(attitudes_of(views.priors))
    return _refined(views, table_of(views.rays, matches), matrices, before, _widening(views))


def _estimates_soft(views: Views, matches: BoolArray, fit: Fit) -> list[Answer]:
    agree = matches & (fit.squared <= INLIER_DEVIATIONS**2)
    stack = soft.conclude(views.rays, agree, _posterior(views, fit))
    rows = zip(stack.rows(), views.priors, strict=True)
    return [answer_of(soft.estimate_of, row, prior) for row, prior in rows]


def _plausible_uncalibrated(views: Views) -> BoolArray:
    stretch = np.array([wrong_lens.stretch(prior) for prior in views.priors])
    return plausible_matches(views.rays, attitudes_of(views.priors), stretch)


def _refine_uncalibrated(views: Views, matches: BoolArray) -> Fit:
    lenses = np.array([prior.lens.known for prior in views.priors])
    before = wrong_lens.lens_prior(attitudes_of(views.priors), lenses)
    table = table_of(views.rays, matches, image_axes)
    return _refined(views, table, wrong_lens.model, before, _widening(views))


def _estimates_uncalibrated(views: Views, matches: BoolArray, fit: Fit) -> list[Answer]:
    stack = uncalibrated.conclude(views.rays, matches, fit, _posterior(views, fit))
    rows = zip(stack.rows(), views.priors, strict=True)
    return [answer_of(uncalibrated.estimate_of, row, prior) for row, prior in rows]


PLANAR_2DOF = BatchMethod(
    two.MIN_MATCHES, _plausible_2dof, _refine_2dof, _estimates_2dof, two.search
)
SOFT_PLANAR = BatchMethod(
    soft.MIN_MATCHES, _plausible_soft, _refine_soft, _estimates_soft, soft.search
)
SOFT_UNCALIBRATED = BatchMethod(
    soft.MIN_MATCHES,
    _plausible_uncalibrated,
    _refine_uncalibrated,
    _estimates_uncalibrated,
    uncalibrated.search,
)
