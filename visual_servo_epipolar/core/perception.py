"""From matched features to what the servo acts on: bearings, parallax, rotation, D."""

from collections.abc import Sequence
from dataclasses import dataclass, field
import math
from typing import NamedTuple, TypeAlias

import numpy as np

from visual_servo_epipolar.core.arrays import FloatArray, median_of_sorted
from visual_servo_epipolar.core.camera import Camera
from visual_servo_epipolar.core.epipolar import (
    Bearings,
    rotations_desired_current,
)
from visual_servo_epipolar.core.estimators.base import Estimate, Prior, UNKNOWN_COVARIANCE
from visual_servo_epipolar.core.estimators.by_name import estimates
from visual_servo_epipolar.core.features import Features
from visual_servo_epipolar.core.homography import fit_rotations, RotationFits
from visual_servo_epipolar.core.measures import (
    difference_deviation,
    distances,
    feature_difference,
    room_to_turn,
    turned,
    usual_difference,
)
from visual_servo_epipolar.core.motion import HALF_PI
from visual_servo_epipolar.core.servo_settings import ServoSettings
from visual_servo_epipolar.core.trust import (
    doubt,
    Evidence,
    evidence,
    fresh_memory,
    Memory,
    remembered,
)

STACK = 32  # views that are perceived at once: more would not stay in the cache
NOISE_ADAPTION = 0.1
NOISE_RANGE = (0.2, 5.0)  # of the noise that the settings give to begin with


@dataclass(frozen=True, slots=True, eq=False)
class Observation:
    """
    One set of matches as rays, shape (N, 2) each, taken at ``stamp_ns``.

    ``focal`` [px] only turns pixel thresholds into angles and back. ``edges`` are the bearings of
    the left and the right edge of the image [rad], right positive.
    """

    stamp_ns: int
    current: FloatArray
    desired: FloatArray
    focal: float
    edges: tuple[float, float] = (-HALF_PI, HALF_PI)


def observe(features: Features, camera: Camera, stamp_ns: int) -> Observation:
    """Back-project tracked features to rays, with the distortion of the camera removed."""
    return observe_each([features], camera, [stamp_ns])[0]


def observe_each(
    features: Sequence[Features], camera: Camera, stamps_ns: Sequence[int]
) -> list[Observation]:
    """Do the same for many views through alike cameras."""
    both = [pixels for each in features for pixels in (each.current, each.desired)]
    rays = camera.rays(np.concatenate(both)) if both else np.empty((0, 2))
    rays.flags.writeable = False
    focal, first, made = math.sqrt(camera.fx * camera.fy), 0, []
    for each, stamp_ns in zip(features, stamps_ns, strict=True):
        middle, last = first + len(each), first + 2 * len(each)
        views = rays[first:middle], rays[middle:last]
        made.append(Observation(stamp_ns, *views, focal, camera.edges))
        first = last
    return made


@dataclass(frozen=True, slots=True, eq=False)
class Sight:
    """
    What one observation tells about the goal, at unit focal length.

    ``bearings`` is None where they cannot be trusted, and ``reason`` says why. ``difference`` is D
    of eq. (23), averaged over the features, ``difference_deviation`` its noise; ``feature_error``
    the median distance of current from desired features; ``parallax`` what the best rotation
    leaves unexplained; ``heading_error`` comes from the bearings where there are any, else from
    that rotation. ``deviation`` is the larger one of psi and phi, ``covariance`` that of both,
    shape (2, 2), ``jump`` the change of tilt and roll between the views [rad]; ``room`` is how far
    the robot may turn to the left and to the right before the features run out of the image [rad];
    ``memory`` is for the next frame.
    """

    stamp_ns: int
    features: int
    focal: float
    memory: Memory
    bearings: Bearings | None = None
    deviation: float = math.nan
    covariance: FloatArray = field(default_factory=lambda: UNKNOWN_COVARIANCE)
    jump: float = 0.0
    confidence: float = 0.0
    inliers: int = 0
    parallax: float = math.nan
    heading_error: float = math.nan
    difference: float = math.nan
    difference_deviation: float = math.nan
    feature_error: float = math.nan
    room: tuple[float, float] = (math.inf, math.inf)
    reason: str = ''

    @property
    def noise(self) -> float:
        """Deviation of a coordinate at unit focal length, as the residuals show it."""
        return self.memory.noise / self.focal

    @property
    def parallax_px(self) -> float:
        """Parallax in pixels."""
        return self.parallax * self.focal


class Glimpse(NamedTuple):
    """
    What is needed to perceive: matches, and what was known before them.

    ``frame`` numbers the observations of a run: with the seed it fixes every random choice.
    ``memory`` is that of the last Sight, None before the first.
    """

    observation: Observation
    settings: ServoSettings
    frame: int
    memory: Memory | None = None

    @classmethod
    def after(
        cls, sight: Sight | None, observation: Observation, settings: ServoSettings, frame: int
    ) -> 'Glimpse':
        """Return the glimpse that follows the last Sight, None before the first."""
        return cls(observation, settings, frame, None if sight is None else sight.memory)


Finding: TypeAlias = tuple[Sight, FloatArray | None]


def perceive(
    observation: Observation, settings: ServoSettings, frame: int, memory: Memory | None = None
) -> Sight:
    """
    Measure what the servo needs; never raises on degenerate views, says so in the Sight.

    See ``Glimpse``.
    """
    return geometry(observation, settings, frame, memory)[0]


def perceive_each(glimpses: Sequence[Glimpse]) -> list[Sight]:
    """
    Perceive many views, of as many robots, side by side.

    Each Sight is, bit by bit, what it would be alone.
    """
    return [sight for sight, _ in geometries(glimpses)]


def geometry(
    observation: Observation, settings: ServoSettings, frame: int, memory: Memory | None
) -> Finding:
    """Return what one observation tells, and F for rays, (3, 3), where one was estimated."""
    return geometries([Glimpse(observation, settings, frame, memory)])[0]


def geometries(glimpses: Sequence[Glimpse]) -> list[Finding]:
    """Return what each glimpse tells, and F for rays, shape (3, 3), where one was estimated."""
    found: list[Finding | None] = [None] * len(glimpses)
    equal: dict[tuple[int, str], list[int]] = {}  # stacks need equally many features
    for k, (observation, settings, _, memory) in enumerate(glimpses):
        count = len(observation.current)
        if count < settings.min_features:
            reason = f'{count} features, {settings.min_features} needed'
            blank = memory or fresh_memory(settings)
            found[k] = (
                Sight(observation.stamp_ns, count, observation.focal, blank, reason=reason),
                None,
            )
        else:
            equal.setdefault((count, settings.estimator), []).append(k)
    for places in equal.values():
        for first in range(0, len(places), STACK):
            some = places[first : first + STACK]
            for k, finding in zip(some, _stacked([glimpses[k] for k in some]), strict=True):
                found[k] = finding
    return [finding for finding in found if finding is not None]


class _Stack(NamedTuple):
    """Glimpses of equally many features: rays, shape (B, N, 2), and their best rotations."""

    glimpses: Sequence[Glimpse]
    current: FloatArray
    desired: FloatArray
    rotations: RotationFits

    def take(self, rows: Sequence[int]) -> '_Stack':
        """Return the glimpses in ``rows``, which ascend."""
        if len(rows) == len(self.glimpses):
            return self
        chosen = np.array(rows)
        return _Stack(
            [self.glimpses[row] for row in rows],
            self.current[chosen],
            self.desired[chosen],
            RotationFits(*(part[chosen] for part in self.rotations)),
        )


class _Verdict(NamedTuple):
    """What is believed of the geometry of one glimpse, or why nothing is, and the memory of it."""

    memory: Memory
    reason: str
    estimate: Estimate | None = None
    shown: Evidence | None = None

    @property
    def bearings(self) -> Bearings | None:
        """The bearings, if they can be trusted."""
        return None if self.reason or self.estimate is None else self.estimate.bearings


def _stacked(glimpses: Sequence[Glimpse]) -> list[Finding]:
    """Return what glimpses of equally many features tell, by one estimator."""
    current = np.array([glimpse.observation.current for glimpse in glimpses])
    desired = np.array([glimpse.observation.desired for glimpse in glimpses])
    stack = _Stack(glimpses, current, desired, fit_rotations(current, desired))
    verdicts = _verdicts(stack)
    headings = stack.rotations.heading_error.tolist()
    for k, verdict in enumerate(verdicts):
        if verdict.bearings is not None:
            headings[k] = verdict.bearings.heading_error
    measured = _measured(stack, verdicts, headings)
    return [
        (
            _sight(glimpse, verdict, row),
            None if verdict.estimate is None else verdict.estimate.fundamental,
        )
        for glimpse, verdict, row in zip(glimpses, verdicts, measured, strict=True)
    ]


class _Measured(NamedTuple):
    """The fields of a Sight that need no estimate but the heading."""

    parallax: float
    heading_error: float
    difference: float
    difference_deviation: float
    feature_error: float
    room_left: float
    room_right: float


def _measured(
    stack: _Stack, verdicts: Sequence[_Verdict], headings: Sequence[float]
) -> list[_Measured]:
    """Return what is measured under the ``headings``."""
    error = median_of_sorted(np.sort(distances(stack.current, stack.desired), axis=1))
    noise = np.array([verdict.memory.noise for verdict in verdicts])
    focal = np.array([glimpse.observation.focal for glimpse in stack.glimpses])
    everything = np.ones(stack.current.shape[1], bool)
    rooms = room_to_turn(
        stack.current,
        np.array([everything if v.estimate is None else v.estimate.inliers for v in verdicts]),
        np.array([glimpse.observation.edges for glimpse in stack.glimpses]),
        np.array([glimpse.settings.keep_features for glimpse in stack.glimpses]),
    )
    columns = (
        stack.rotations.parallax,
        headings,
        _differences(stack, np.array(headings)),
        difference_deviation(stack.desired, noise / focal),
        error,
        *rooms.T,
    )
    return [_Measured(*row) for row in np.array(columns).T.tolist()]


def _verdicts(stack: _Stack) -> list[_Verdict]:
    """Return what is believed of each geometry; a small parallax shows none."""
    found, wide = [], []
    parallax = stack.rotations.parallax.tolist()
    for k, (observation, settings, _, memory) in enumerate(stack.glimpses):
        parallax_px, reason = parallax[k] * observation.focal, ''
        if parallax_px < settings.min_parallax:
            reason = f'a parallax of {parallax_px:.2f} px is too small for epipoles'
        else:
            wide.append(k)
        found.append(_Verdict(memory or fresh_memory(settings), reason))
    if wide:
        memories = [found[k].memory for k in wide]
        for k, verdict in zip(wide, _judged(stack.take(wide), memories), strict=True):
            found[k] = verdict
    return found


def _judged(stack: _Stack, memories: Sequence[Memory]) -> list[_Verdict]:
    """Return what is believed of geometries that show parallax."""
    glimpses = stack.glimpses
    focal = np.array([glimpse.observation.focal for glimpse in glimpses])
    noise = np.array([memory.noise for memory in memories])
    answers = estimates(
        glimpses[0].settings.estimator,
        stack.current,
        stack.desired,
        noise=noise / focal,
        priors=[
            Prior(memory.attitude, memory.bearings, glimpse.settings.max_leap)
            for memory, glimpse in zip(memories, glimpses, strict=True)
        ],
        seeds=[(glimpse.settings.seed, glimpse.frame) for glimpse in glimpses],
    )
    seen = {k: answer for k, answer in enumerate(answers) if isinstance(answer, Estimate)}
    shown: dict[int, Evidence] = {}
    if seen:
        some = stack.take(list(seen))
        found = evidence(list(seen.values()), some.current, some.desired)
        shown = dict(zip(seen, found, strict=True))
    parallax = stack.rotations.parallax.tolist()
    return [
        _verdict(glimpse, memory, answer, shown[k], parallax[k])
        if isinstance(answer, Estimate)
        else _Verdict(memory, str(answer))
        for k, (glimpse, memory, answer) in enumerate(
            zip(glimpses, memories, answers, strict=True)
        )
    ]


def _verdict(
    glimpse: Glimpse, memory: Memory, estimate: Estimate, shown: Evidence, parallax: float
) -> _Verdict:
    """Return whether ``estimate`` is believed, and what is remembered of it."""
    observation, settings = glimpse.observation, glimpse.settings
    reason = doubt(estimate, shown, memory, settings)
    after = remembered(
        memory,
        estimate,
        reason,
        noise=_noise(shown.residual, observation, memory.noise, settings.pixel_noise),
        parallax=parallax * observation.focal,
    )
    return _Verdict(after, reason, estimate, shown)


def _differences(stack: _Stack, headings: FloatArray) -> FloatArray:
    """Return D of each glimpse, of features turned as the goal is where settings say so."""
    made = feature_difference(stack.current, stack.desired)
    compensated = np.array([glimpse.settings.compensates for glimpse in stack.glimpses])
    if compensated.any():
        # Pitch and roll of an uneven floor are those of the best rotation, the heading is better.
        better = rotations_desired_current(headings - stack.rotations.heading_error)
        level = turned(stack.current, better @ stack.rotations.rotation)
        made = np.where(compensated, usual_difference(level, stack.desired), made)
    return made


def _sight(glimpse: Glimpse, verdict: _Verdict, measured: _Measured) -> Sight:
    observation, estimate, shown = glimpse.observation, verdict.estimate, verdict.shown
    return Sight(
        observation.stamp_ns,
        len(observation.current),
        observation.focal,
        verdict.memory,
        bearings=verdict.bearings,
        deviation=math.nan if shown is None else shown.deviation,
        covariance=UNKNOWN_COVARIANCE if estimate is None else estimate.covariance,
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


def _noise(residual: float, observation: Observation, before: float, first: float) -> float:
    """Return the deviation of a coordinate [px], slowly following the median ``residual``."""
    spare = max(len(observation.current) - 2, 1)
    now = 1.4826 * (1.0 + 5.0 / spare) * residual * observation.focal
    followed = before + NOISE_ADAPTION * (now - before)
    return min(max(followed, NOISE_RANGE[0] * first), NOISE_RANGE[1] * first)
