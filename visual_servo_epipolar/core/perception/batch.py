"""
Many views of as many robots at once: the door through which sweeps go, not the robot's way.

Each Perception is, to the last bit, what ``perceive`` gives of its view alone: the numerical
functions take leading axes, and what decides is shared.
"""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from visual_servo_epipolar.core.arrays import BoolArray, FloatArray, medians
from visual_servo_epipolar.core.estimators.base import Estimate
from visual_servo_epipolar.core.estimators.registry import estimates
from visual_servo_epipolar.core.geometry.epipolar import rotations_desired_current
from visual_servo_epipolar.core.geometry.lens import change, spurious_parallax
from visual_servo_epipolar.core.geometry.rotation import fit_rotations, RotationFits
from visual_servo_epipolar.core.perception import measures
from visual_servo_epipolar.core.perception.memory import fresh_memory, PerceptionMemory
from visual_servo_epipolar.core.perception.observation import Observation
from visual_servo_epipolar.core.perception.perceive import (
    blank,
    Measures,
    Perception,
    perception,
    usual_matches,
)
from visual_servo_epipolar.core.perception.settings import PerceptionSettings
from visual_servo_epipolar.core.perception.validated import (
    concluded,
    lesson_of,
    no_baseline,
    noise_learnt,
    noises_learnt,
    prior_of,
    SPARED,
    ValidatedEstimate,
    without_baseline,
)
from visual_servo_epipolar.core.perception.validation import (
    angular_extent,
    FitQuality,
    median_residual,
)

STACK = 64  # views that are perceived at once: more would not stay in the cache


class RobotView(NamedTuple):
    """What ``perceive`` takes of one robot: matches, and what was known before them."""

    observation: Observation
    settings: PerceptionSettings
    frame: int
    memory: PerceptionMemory | None = None


class _Known(NamedTuple):
    """A view with its memory, and its rays as the memory corrects them."""

    observation: Observation
    settings: PerceptionSettings
    frame: int
    memory: PerceptionMemory


class _Stack(NamedTuple):
    """Views of equally many features: unit rays, shape (B, N, 3), and their best rotations."""

    views: Sequence[_Known]
    current: FloatArray
    desired: FloatArray
    rotations: RotationFits

    def take(self, rows: Sequence[int]) -> '_Stack':
        """Return the views in ``rows``, which ascend."""
        if len(rows) == len(self.views):
            return self
        chosen = np.array(rows, dtype=np.int64)
        return _Stack(
            [self.views[row] for row in rows],
            self.current[chosen],
            self.desired[chosen],
            RotationFits(*(part[chosen] for part in self.rotations)),
        )


def perceive_each(views: Sequence[RobotView]) -> list[Perception]:
    """Perceive many views; each Perception is, bit by bit, what it would be alone."""
    perceptions: dict[int, Perception] = {}
    alike: dict[tuple[int, str, bool], list[int]] = {}
    for k, view in enumerate(views):
        settings, count = view.settings, len(view.observation)
        if count < settings.min_features:
            memory = noise_learnt(view.memory or fresh_memory(settings))
            perceptions[k] = blank(view.observation, settings, memory)
        else:
            alike.setdefault((count, settings.estimator, settings.calibrated), []).append(k)
    for places in alike.values():
        for first in range(0, len(places), STACK):
            some = places[first : first + STACK]
            stacked = _perceive_stack([views[k] for k in some])
            perceptions.update(zip(some, stacked, strict=True))
    return [perceptions[k] for k in range(len(views))]


def _perceive_stack(views: Sequence[RobotView]) -> list[Perception]:
    """Perceive views of equally many features by one estimator."""
    memories = noises_learnt([view.memory or fresh_memory(view.settings) for view in views])
    known = [_known(view, memory) for view, memory in zip(views, memories, strict=True)]
    stack = _stack_of(known)
    estimates = _validated_estimates(stack)
    stack = _corrected(stack, estimates)
    measured = _measures(stack, estimates)
    return [
        perception(view.observation, row, estimate, before.memory)
        for view, row, estimate, before in zip(
            stack.views, measured, estimates, known, strict=True
        )
    ]


def _known(view: RobotView, memory: PerceptionMemory) -> _Known:
    observation = view.observation.corrected(memory.lens)
    return _Known(observation, view.settings, view.frame, memory)


def _stack_of(views: Sequence[_Known]) -> _Stack:
    current = np.array([view.observation.current for view in views])
    desired = np.array([view.observation.desired for view in views])
    return _Stack(views, current, desired, fit_rotations(current, desired))


def _corrected(stack: _Stack, estimates: Sequence[ValidatedEstimate]) -> _Stack:
    """Return ``stack`` through the cameras as they are known after the ``estimates``."""
    changes = [
        change(estimate.memory.lens, view.memory.lens)
        for view, estimate in zip(stack.views, estimates, strict=True)
    ]
    if all(lens.corrects_nothing for lens in changes):
        return stack
    return _stack_of(
        [
            view._replace(observation=view.observation.corrected(lens))
            for view, lens in zip(stack.views, changes, strict=True)
        ]
    )


def _validated_estimates(stack: _Stack) -> list[ValidatedEstimate]:
    """Return the validated estimate of each view; a small parallax shows none."""
    parallax = stack.rotations.parallax.tolist()
    reasons = [
        no_baseline(seen * view.observation.focal, view.settings)
        for view, seen in zip(stack.views, parallax, strict=True)
    ]
    results = {
        k: without_baseline(
            view.observation, stack.rotations.rotation[k], view.memory, view.settings, reason
        )
        for k, (view, reason) in enumerate(zip(stack.views, reasons, strict=True))
        if reason
    }
    for k, view in enumerate(stack.views):
        if k not in results and view.memory.two_view_skip:
            results[k] = ValidatedEstimate(view.memory, SPARED)
    apart = [k for k in range(len(stack.views)) if k not in results]
    if apart:
        results.update(zip(apart, _estimated(stack.take(apart)), strict=True))
    return [results[k] for k in range(len(stack.views))]


def _estimated(stack: _Stack) -> list[ValidatedEstimate]:
    """Return the validated estimates of views that show parallax."""
    views = stack.views
    noise = np.array([view.memory.noise for view in views])
    resolution = np.array([view.observation.resolution for view in views])
    answers = estimates(
        views[0].settings.estimator,
        stack.current,
        stack.desired,
        noise=noise[:, None, None] * resolution,
        priors=[prior_of(view.memory, view.settings) for view in views],
        seeds=[(view.settings.seed, view.frame) for view in views],
    )
    some = [k for k, answer in enumerate(answers) if isinstance(answer, Estimate)]
    geometries = [answer for answer in answers if isinstance(answer, Estimate)]
    judged = dict(zip(some, _judged(stack.take(some), geometries, resolution[some]), strict=True))
    return [
        judged[k] if k in judged else ValidatedEstimate(view.memory, str(answers[k]))
        for k, view in enumerate(views)
    ]


def _judged(
    stack: _Stack, geometries: Sequence[Estimate], resolution: FloatArray
) -> list[ValidatedEstimate]:
    """Return estimates with the verdict of the gates, and the memories after them."""
    qualities = _fit_qualities(stack, geometries, resolution)
    lessons = [
        lesson_of(view.observation, rotation, view.memory, view.settings, geometry, quality)
        for view, rotation, geometry, quality in zip(
            stack.views, stack.rotations.each(), geometries, qualities, strict=True
        )
    ]
    return concluded(lessons, qualities)


def _fit_qualities(
    stack: _Stack, geometries: Sequence[Estimate], resolution: FloatArray
) -> list[FitQuality]:
    """Return how well each estimate fits its view, with angles of a pixel, (B, N, 2)."""
    if not geometries:
        return []
    inliers = np.array([geometry.inliers for geometry in geometries])
    fundamental = np.array([geometry.fundamental for geometry in geometries])
    covariance = np.array([geometry.covariance for geometry in geometries])
    variance = np.maximum(covariance[:, 0, 0], covariance[:, 1, 1])
    columns = (
        np.count_nonzero(inliers, axis=1).tolist(),
        angular_extent(stack.desired, inliers).tolist(),
        np.sqrt(np.maximum(variance, 0.0)).tolist(),
        median_residual(fundamental, stack.current, stack.desired, resolution).tolist(),
    )
    return [FitQuality(*row) for row in zip(*columns, strict=True)]


def _measures(stack: _Stack, estimates: Sequence[ValidatedEstimate]) -> list[Measures]:
    """Return what is measured of each view under its heading."""
    headings = np.array(
        [
            rotation if estimate.bearings is None else estimate.bearings.heading_error
            for rotation, estimate in zip(
                stack.rotations.heading_error.tolist(), estimates, strict=True
            )
        ]
    )
    counted = np.array(
        [
            usual_matches(view.observation, estimate)
            for view, estimate in zip(stack.views, estimates, strict=True)
        ]
    )
    noise = np.array([estimate.memory.noise for estimate in estimates])
    focal = np.array([view.observation.focal for view in stack.views])
    deviations = measures.difference_deviation(
        stack.current, stack.desired, noise / focal, _wide(stack)
    )
    # As ``perceive``: a memory of views knows D.
    spared = np.array([estimate.memory.two_view_skip > 0 for estimate in estimates])
    distances = measures.distances(stack.current, stack.desired)
    columns = (
        _parallaxes(stack, estimates, headings).tolist(),
        headings.tolist(),
        stack.rotations.heading_error.tolist(),
        np.where(spared, np.nan, _differences(stack, headings, counted)).tolist(),
        np.where(spared, np.nan, deviations).tolist(),
        medians(distances).tolist(),
        _view_margins(stack, counted),
    )
    return [Measures(*row) for row in zip(*columns, strict=True)]


def _view_margins(stack: _Stack, counted: BoolArray) -> list[tuple[float, float]]:
    """Return how far each robot may turn left and right [rad]."""
    left, right = measures.view_margins(
        stack.current,
        counted,
        np.array([view.observation.edges for view in stack.views]),
        np.array([view.settings.keep_features for view in stack.views]),
    )
    return list(zip(left.tolist(), right.tolist(), strict=True))


def _parallaxes(
    stack: _Stack, estimates: Sequence[ValidatedEstimate], headings: FloatArray
) -> FloatArray:
    """Return the parallaxes beyond what lenses that are not known may show in a turn."""
    parallax = stack.rotations.parallax
    if stack.views[0].settings.calibrated:
        return parallax
    roots = np.array([estimate.memory.lens.root for estimate in estimates])
    spurious = spurious_parallax(stack.desired, headings, roots)
    return np.sqrt(np.maximum(parallax * parallax - spurious * spurious, 0.0))


def _differences(stack: _Stack, headings: FloatArray, counted: BoolArray) -> FloatArray:
    """Return D of each view, of features turned as the goal is where settings say so."""
    plain = measures.feature_difference(stack.current, stack.desired, _wide(stack))
    compensated = np.array([view.settings.compensates for view in stack.views])
    if not compensated.any():
        return plain
    better = rotations_desired_current(headings - stack.rotations.heading_error)
    level = measures.turned(stack.current, better @ stack.rotations.rotation)
    usual = measures.usual_difference(level, stack.desired, _wide(stack), counted)
    return np.where(compensated, usual, plain)


def _wide(stack: _Stack) -> BoolArray:
    """Return which views are through a wide lens, shape (B,)."""
    return np.array([view.observation.wide for view in stack.views])
