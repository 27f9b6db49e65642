"""
Many pairs of views side by side, as sweeps have them: what planar estimators share.

Where the last bearings of a pair are known and still fit, which is nearly every frame of a run,
all pairs are refined in one stack. The others are searched one after the other. Every estimate is,
to the last bit, what the pair gives alone.
"""

from collections.abc import Callable, Sequence
from typing import Any, NamedTuple, TypeAlias

import numpy as np

from visual_servo_epipolar.core.arrays import BoolArray, FloatArray, IntArray
from visual_servo_epipolar.core.errors import DegenerateGeometryError
from visual_servo_epipolar.core.estimators.base import Estimate, Prior
from visual_servo_epipolar.core.estimators.machinery.hypotheses import Rays, rays_of
from visual_servo_epipolar.core.estimators.machinery.refinement import (
    annealed,
    Fit,
    gauss_newton_step,
    is_consistent,
    ITERATIONS,
    Problem,
    SHORT_ANNEALING,
)

Answer: TypeAlias = Estimate | DegenerateGeometryError


class Views(NamedTuple):
    """
    Pairs of views with equally many matches: rays, shape (B, N), and priors.

    ``angles``, shape (B, 2), holds the last psi and phi, nan where there are none, and
    ``deviation``, (B,), how far they may have moved.
    """

    rays: Rays
    priors: Sequence[Prior]
    angles: FloatArray
    deviation: FloatArray

    def take(self, rows: Sequence[int]) -> 'Views':
        """Return the pairs in ``rows``, which ascend."""
        if len(rows) == len(self.priors):
            return self
        chosen = np.array(rows)
        return Views(
            self.rays.take(chosen),
            [self.priors[row] for row in rows],
            self.angles[chosen],
            self.deviation[chosen],
        )


def views_of(
    current: FloatArray, desired: FloatArray, noise: FloatArray, priors: Sequence[Prior]
) -> Views:
    """Return views from unit rays, shape (B, N, 3) each, and ``noise``, (B,) or (B, N, 2)."""
    return Views(
        rays_of(current, desired, noise),
        priors,
        np.array([prior.angles for prior in priors]),
        np.array([prior.deviation for prior in priors]),
    )


class BatchMethod(NamedTuple):
    """
    An estimator taken apart, so that its cheap part serves many views at once.

    ``plausible`` says which matches are possible, (B, N); ``refine`` refines the last bearings of
    all pairs; ``estimates`` turns consistent fits into estimates; ``search`` is for one pair.
    """

    min_matches: int
    plausible: Callable[[Views], BoolArray]
    refine: Callable[[Views, BoolArray], Fit]
    estimates: Callable[[Views, BoolArray, Fit], list[Answer]]
    search: Callable[[Rays, BoolArray, Prior], Estimate]


def answers(views: Views, method: BatchMethod) -> list[Answer]:
    """Return the estimate of each pair of ``views``, or the error that says why there is none."""
    matches = method.plausible(views)
    consistent = dict(_consistent(views, matches, method))
    return [
        consistent[k] if k in consistent else _searched(views, matches, k, method)
        for k in range(len(views.priors))
    ]


def answer_of(estimate: Callable[..., Estimate], *args: Any, **options: Any) -> Answer:
    """Return the estimate that ``estimate`` gives of these arguments, or the error it raises."""
    try:
        return estimate(*args, **options)
    except DegenerateGeometryError as error:
        return error


def _consistent(views: Views, matches: BoolArray, method: BatchMethod) -> list[tuple[int, Answer]]:
    """Return places and answers of the pairs whose last bearings still fit."""
    counts = matches.sum(axis=1)
    enough = (counts >= method.min_matches).tolist()
    known = [k for k, prior in enumerate(views.priors) if prior.bearings and enough[k]]
    if not known:
        return []
    if len(known) < len(enough):
        views, matches, counts = views.take(known), matches[known], counts[known]
    fit = method.refine(views, matches)
    fits = is_consistent(fit, views.angles, views.deviation, counts)
    rows = np.flatnonzero(fits).tolist()
    if not rows:
        return []
    if len(rows) < len(known):
        views, matches, fit = views.take(rows), matches[rows], fit.take(np.array(rows))
    estimates = method.estimates(views, matches, fit)
    return [(known[row], answer) for row, answer in zip(rows, estimates, strict=True)]


def _searched(views: Views, matches: BoolArray, k: int, method: BatchMethod) -> Answer:
    """Return the answer for pair ``k``, of which nothing is known, or nothing that fits."""
    return answer_of(method.search, views.rays.take(k), matches[k], views.priors[k])


def refined_each(
    start: FloatArray, problem: Problem, *, negligible: FloatArray, scale: FloatArray
) -> Fit:
    """
    Minimise by Gauss-Newton in many geometries side by side, from one ``start`` each, (B, P).

    ``negligible`` and ``scale`` have shape (B,). Each goes its own way and ends when its own step
    is negligible: nothing depends on what is beside it. Singular equations give nan.
    """
    remaining, ended = np.arange(len(start)), []
    for iteration in range(1, ITERATIONS + 1):
        width = annealed(scale, iteration, SHORT_ANNEALING)[:, None]
        step = gauss_newton_step(problem, start, width)
        going = (width[:, 0] > 1.0) | (step.length >= negligible)
        count = np.count_nonzero(going)
        if iteration == ITERATIONS or not count:
            ended.append((remaining, step.fit(problem, width)))
            break
        start = step.parameters
        if count < len(going):
            done = ~going
            ended.append((remaining[done], step.take(done).fit(problem.take(done), width[done])))
            remaining, start, problem = remaining[going], start[going], problem.take(going)
            negligible, scale = negligible[going], scale[going]
    return _in_order(ended)


def _in_order(ended: list[tuple[IntArray, Fit]]) -> Fit:
    if len(ended) == 1:
        return ended[0][1]
    order = np.concatenate([places for places, _ in ended]).argsort()
    parts = zip(*(fit for _, fit in ended), strict=True)
    return Fit(*(np.concatenate(part)[order] for part in parts))
