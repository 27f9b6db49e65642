"""
Many pairs of views at once, one after the other or side by side: what planar estimators share.

Where the last bearings of a pair are known and still fit, which is nearly every frame of a run,
all pairs are refined in one stack. The others are searched alone. A robot has a stack of one.
"""

from collections.abc import Callable, Sequence
from typing import NamedTuple, TypeAlias

import numpy as np

from visual_servo_epipolar.core.arrays import BoolArray, FloatArray, IntArray
from visual_servo_epipolar.core.errors import DegenerateGeometryError
from visual_servo_epipolar.core.estimators.base import Estimate, Prior
from visual_servo_epipolar.core.estimators.machinery.hypotheses import Rays, rays_of, too_few
from visual_servo_epipolar.core.estimators.machinery.refinement import Fit, goes_on
from visual_servo_epipolar.core.geometry.epipolar import Bearings

Answer: TypeAlias = Estimate | DegenerateGeometryError


class Views(NamedTuple):
    """
    Pairs of views with equally many matches: rays, shape (B, N), noise, (B,), and priors.

    ``before``, shape (B, 2), holds the last psi and phi, nan where there are none, and
    ``deviation``, (B,), how far they may have moved.
    """

    rays: Rays
    noise: FloatArray
    priors: Sequence[Prior]
    before: FloatArray
    deviation: FloatArray

    def take(self, rows: Sequence[int]) -> 'Views':
        """Return the pairs in ``rows``, which ascend."""
        if len(rows) == len(self.priors):
            return self
        chosen = np.array(rows)
        return Views(
            Rays(*(part[chosen] for part in self.rays)),
            self.noise[chosen],
            [self.priors[row] for row in rows],
            self.before[chosen],
            self.deviation[chosen],
        )


class Method(NamedTuple):
    """
    What one planar estimator does with views.

    ``keep`` says which matches are possible, (B, N); ``follow`` refines the last bearings;
    ``search`` looks for bearings in one pair, and for an alternative; ``conclude`` makes
    estimates of fits, whose ``squared`` cover all matches.
    """

    min_matches: int
    keep: Callable[[Views], BoolArray]
    follow: Callable[[Views, BoolArray], Fit]
    search: Callable[[Rays, float, Prior], tuple[Fit, int, Bearings | None]]
    conclude: Callable[[Views, BoolArray, Fit, Sequence[Bearings | None]], list[Answer]]


def views_of(
    current: FloatArray, desired: FloatArray, noise: FloatArray, priors: Sequence[Prior]
) -> Views:
    """Return views from rays, shape (B, N, 2) each."""
    known = [prior.bearings for prior in priors]
    return Views(
        rays_of(current, desired),
        noise,
        priors,
        np.array([(b.psi, b.phi) if b else (np.nan, np.nan) for b in known]),
        np.array([prior.deviation for prior in priors]),
    )


def answers(views: Views, method: Method) -> list[Answer]:
    """Return the estimate of each pair of ``views``, or the error that says why there is none."""
    kept = method.keep(views)
    counts = kept.sum(axis=1)
    found: list[Answer | None] = [None] * len(views.priors)
    for k, answer in _followed(views, kept, counts, method):
        found[k] = answer
    return [
        _searched(views.take([k]), kept[k : k + 1], method) if answer is None else answer
        for k, answer in enumerate(found)
    ]


def alone(
    current: FloatArray, desired: FloatArray, noise: float, prior: Prior, method: Method
) -> Estimate:
    """Return the estimate from one pair of views, rays of shape (N, 2); raises what it answers."""
    views = views_of(current[None], desired[None], np.array([noise]), [prior])
    answer = answers(views, method)[0]
    if isinstance(answer, DegenerateGeometryError):
        raise answer
    return answer


def _followed(
    views: Views, kept: BoolArray, counts: IntArray, method: Method
) -> list[tuple[int, Answer]]:
    """Return places and answers of the pairs whose last bearings still fit."""
    enough = (counts >= method.min_matches).tolist()
    known = [k for k, prior in enumerate(views.priors) if prior.bearings and enough[k]]
    if not known:
        return []
    if len(known) < len(enough):
        views, kept, counts = views.take(known), kept[known], counts[known]
    fit = method.follow(views, kept)
    on = np.flatnonzero(goes_on(fit, views.before, views.deviation, counts)).tolist()
    if not on:
        return []
    if len(on) < len(known):
        views, kept, fit = views.take(on), kept[on], fit.take(np.array(on))
    made = method.conclude(views, kept, fit, [None] * len(on))
    return [(known[k], answer) for k, answer in zip(on, made, strict=True)]


def _searched(views: Views, kept: BoolArray, method: Method) -> Answer:
    """Return the answer for one pair of which nothing is known, or nothing that fits."""
    rays, row = Rays(*(part[0] for part in views.rays)), kept[0]
    if not row.all():
        rays = Rays(*(part[row] for part in rays))
    if len(rays.u_a) < method.min_matches:
        return too_few(len(rays.u_a), len(row), method.min_matches)
    try:
        fit, best, alternative = method.search(rays, float(views.noise[0]), views.priors[0])
    except DegenerateGeometryError as error:
        return error
    squared = np.full(kept.shape, np.inf)
    squared[kept] = fit.squared[best]
    fit = fit.take(np.array([best]))._replace(squared=squared)
    return method.conclude(views, kept, fit, [alternative])[0]
