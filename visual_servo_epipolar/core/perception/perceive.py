"""From matched features to what the servo acts on: bearings, parallax, rotation, D."""

from collections.abc import Sequence
import math
from typing import NamedTuple, TypeAlias

import numpy as np

from visual_servo_epipolar.core.arrays import FloatArray, median_of_sorted
from visual_servo_epipolar.core.estimators.base import UNKNOWN_COVARIANCE
from visual_servo_epipolar.core.geometry.camera import Camera
from visual_servo_epipolar.core.geometry.epipolar import rotations_desired_current
from visual_servo_epipolar.core.geometry.lens import change, for_wrong_rays, spurious_parallax
from visual_servo_epipolar.core.geometry.rays import image_points
from visual_servo_epipolar.core.geometry.rotation import fit_rotations
from visual_servo_epipolar.core.perception.measurement import Glimpse, Measurement, Observation
from visual_servo_epipolar.core.perception.measures import (
    difference_deviation,
    distances,
    feature_difference,
    room_to_turn,
    turned,
    usual_difference,
)
from visual_servo_epipolar.core.perception.validated import Stack, Verdict, verdicts
from visual_servo_epipolar.core.perception.validation import fresh_memory, Memory
from visual_servo_epipolar.core.servo.settings import ServoSettings
from visual_servo_epipolar.core.tracking.features import Features

__all__ = [
    'geometries',
    'geometry',
    'Glimpse',
    'Observation',
    'observe',
    'observe_each',
    'perceive',
    'perceive_each',
    'Measurement',
]

STACK = 64  # views that are perceived at once: more would not stay in the cache

Finding: TypeAlias = tuple[Measurement, FloatArray | None]


def observe(features: Features, camera: Camera, stamp_ns: int) -> Observation:
    """Back-project tracked features to rays, with the distortion of the camera removed."""
    return observe_each([features], camera, [stamp_ns])[0]


def observe_each(
    features: Sequence[Features], camera: Camera, stamps_ns: Sequence[int]
) -> list[Observation]:
    """Do the same for many views through alike cameras."""
    both = [pixels for each in features for pixels in (each.current, each.desired)]
    rays = camera.unit_rays(np.concatenate(both)) if both else np.empty((0, 3))
    resolution = camera.resolution(rays)
    rays.flags.writeable = False
    focal, first, made = math.sqrt(camera.fx * camera.fy), 0, []
    for each, stamp_ns in zip(features, stamps_ns, strict=True):
        middle, last = first + len(each), first + 2 * len(each)
        views = rays[first:middle], rays[middle:last]
        angles = np.stack([resolution[first:middle], resolution[middle:last]], axis=1)
        made.append(Observation(stamp_ns, *views, focal, camera.edges, angles))
        first = last
    return made


def perceive(
    observation: Observation, settings: ServoSettings, frame: int, memory: Memory | None = None
) -> Measurement:
    """
    Measure what the servo needs; never raises on degenerate views, says so in the Measurement.

    See ``Glimpse``.
    """
    return geometry(observation, settings, frame, memory)[0]


def perceive_each(glimpses: Sequence[Glimpse]) -> list[Measurement]:
    """
    Perceive many views, of as many robots, side by side.

    Each Measurement is, bit by bit, what it would be alone.
    """
    return [measurement for measurement, _ in geometries(glimpses)]


def geometry(
    observation: Observation, settings: ServoSettings, frame: int, memory: Memory | None
) -> Finding:
    """Return what one observation tells, and F for rays, (3, 3), where one was estimated."""
    return geometries([Glimpse(observation, settings, frame, memory)])[0]


def geometries(glimpses: Sequence[Glimpse]) -> list[Finding]:
    """Return what each glimpse tells, and F for rays, shape (3, 3), where one was estimated."""
    found: list[Finding | None] = [None] * len(glimpses)
    # Stacks need equally many features and one estimator.
    equal: dict[tuple[int, str, bool], list[int]] = {}
    glimpses = [glimpse.corrected(glimpse.lens) for glimpse in glimpses]
    for k, (observation, settings, _, memory) in enumerate(glimpses):
        count = len(observation.current)
        if count < settings.min_features:
            reason = f'{count} features, {settings.min_features} needed'
            blank = memory or fresh_memory(settings)
            found[k] = (
                Measurement(observation.stamp_ns, count, observation.focal, blank, reason=reason),
                None,
            )
        else:
            method = settings.estimator, settings.focal_deviation > 0.0
            equal.setdefault((count, *method), []).append(k)
    for places in equal.values():
        for first in range(0, len(places), STACK):
            some = places[first : first + STACK]
            for k, finding in zip(some, _stacked([glimpses[k] for k in some]), strict=True):
                found[k] = finding
    return [finding for finding in found if finding is not None]


def _stacked(glimpses: Sequence[Glimpse]) -> list[Finding]:
    """Return what glimpses of equally many features tell, by one estimator."""
    stack = _stack_of(glimpses)
    believed = verdicts(stack)
    if glimpses[0].settings.focal_deviation > 0.0:
        stack = _corrected(stack, believed)
    headings = stack.rotations.heading_error.tolist()
    for k, verdict in enumerate(believed):
        if verdict.bearings is not None:
            headings[k] = verdict.bearings.heading_error
    measured = _measured(stack, believed, headings)
    return [
        (_sight(glimpse, verdict, row), _fundamental(glimpse, verdict))
        for glimpse, verdict, row in zip(stack.glimpses, believed, measured, strict=True)
    ]


def _stack_of(glimpses: Sequence[Glimpse]) -> Stack:
    current = np.array([glimpse.observation.current for glimpse in glimpses])
    desired = np.array([glimpse.observation.desired for glimpse in glimpses])
    return Stack(glimpses, current, desired, fit_rotations(current, desired))


def _corrected(stack: Stack, believed: Sequence[Verdict]) -> Stack:
    """Return ``stack`` through the cameras as they are ``believed`` to be now."""
    changes = [
        change(verdict.memory.lens, glimpse.lens)
        for glimpse, verdict in zip(stack.glimpses, believed, strict=True)
    ]
    if all(lens.corrects_nothing for lens in changes):
        return stack
    pairs = zip(stack.glimpses, changes, strict=True)
    return _stack_of([glimpse.corrected(lens) for glimpse, lens in pairs])


def _fundamental(glimpse: Glimpse, verdict: Verdict) -> FloatArray | None:
    """Return F for rays as they came, if there is an estimate."""
    if verdict.estimate is None:
        return None
    return for_wrong_rays(verdict.estimate.fundamental, glimpse.lens)


class _Measured(NamedTuple):
    """The fields of a Measurement that need no estimate but the heading."""

    parallax: float
    heading_error: float
    difference: float
    difference_deviation: float
    feature_error: float
    room_left: float
    room_right: float


def _measured(
    stack: Stack, believed: Sequence[Verdict], headings: Sequence[float]
) -> list[_Measured]:
    """Return what is measured under the ``headings``."""
    current, desired = image_points(stack.current), image_points(stack.desired)
    error = median_of_sorted(np.sort(distances(current, desired), axis=1))
    noise = np.array([verdict.memory.noise for verdict in believed])
    focal = np.array([glimpse.observation.focal for glimpse in stack.glimpses])
    everything = np.ones(stack.current.shape[1], bool)
    rooms = room_to_turn(
        current,
        np.array([everything if v.estimate is None else v.estimate.inliers for v in believed]),
        np.array([glimpse.observation.edges for glimpse in stack.glimpses]),
        np.array([glimpse.settings.keep_features for glimpse in stack.glimpses]),
    )
    columns = (
        _parallaxes(stack, believed, np.array(headings)),
        headings,
        _differences(stack, np.array(headings)),
        difference_deviation(desired, noise / focal),
        error,
        *rooms.T,
    )
    return [_Measured(*row) for row in np.array(columns).T.tolist()]


def _parallaxes(stack: Stack, believed: Sequence[Verdict], headings: FloatArray) -> FloatArray:
    """Return the parallaxes beyond what lenses that are not known may feign in a turn."""
    parallax = stack.rotations.parallax
    if stack.glimpses[0].settings.focal_deviation == 0.0:
        return parallax
    feigned = spurious_parallax(
        stack.desired, headings, np.array([verdict.memory.lens.root for verdict in believed])
    )
    return np.sqrt(np.maximum(parallax * parallax - feigned * feigned, 0.0))


def _differences(stack: Stack, headings: FloatArray) -> FloatArray:
    """Return D of each glimpse, of features turned as the goal is where settings say so."""
    desired = image_points(stack.desired)
    made = feature_difference(image_points(stack.current), desired)
    compensated = np.array([glimpse.settings.compensates for glimpse in stack.glimpses])
    if compensated.any():
        # Pitch and roll of an uneven floor are those of the best rotation, the heading is better.
        better = rotations_desired_current(headings - stack.rotations.heading_error)
        level = turned(stack.current, better @ stack.rotations.rotation)
        made = np.where(compensated, usual_difference(level, desired), made)
    return made


def _sight(glimpse: Glimpse, verdict: Verdict, measured: _Measured) -> Measurement:
    observation, estimate, shown = glimpse.observation, verdict.estimate, verdict.shown
    return Measurement(
        observation.stamp_ns,
        len(observation.current),
        observation.focal,
        verdict.memory,
        bearings=verdict.bearings,
        deviation=math.nan if shown is None else shown.deviation,
        covariance=UNKNOWN_COVARIANCE if estimate is None else estimate.whole_covariance,
        jump=0.0 if estimate is None else estimate.jump,
        confidence=0.0 if estimate is None else estimate.confidence,
        inliers=0 if shown is None else shown.inliers,
        parallax=measured.parallax,
        heading_error=measured.heading_error,
        difference=measured.difference,
        difference_deviation=measured.difference_deviation,
        feature_error=measured.feature_error,
        room=(measured.room_left, measured.room_right),
        reason=verdict.reason,
    )
