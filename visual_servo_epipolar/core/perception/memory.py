"""What perception carries from frame to frame: the camera's attitude, noise, the last bearings."""

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from typing import NamedTuple

import numpy as np

from visual_servo_epipolar.core.arrays import BoolArray, FloatArray
from visual_servo_epipolar.core.estimators.base import Attitude, Estimate
from visual_servo_epipolar.core.geometry.epipolar import Bearings
from visual_servo_epipolar.core.geometry.lens import CALIBRATED, learnt, Lens, unknown_lens
from visual_servo_epipolar.core.perception.observation import Observation
from visual_servo_epipolar.core.perception.settings import PerceptionSettings

KNOWN_DEVIATION = 1.7e-3  # of tilt and roll: the floor moved the desired camera, too [rad]
ROUNDING = 0.05  # of information, in units of what was known
INFORMATIVE_PARALLAX = 12.0  # in deviations of the noise: bearings to about three degrees
IDENTITY = np.eye(2)


class Still(NamedTuple):
    """View without a baseline, its best ``rotation``, (3, 3), and the noise to begin with [px]."""

    observation: Observation
    rotation: FloatArray
    first_noise: float


@dataclass(frozen=True)  # without slots: ``values.changed``
class PerceptionMemory:
    """
    What perception carries from frame to frame.

    ``attitude`` is the camera's, calibrated while driving; ``bearings`` the last trusted ones;
    ``noise`` the deviation of a tracked coordinate [px] as the residuals show it;
    ``consecutive_rejections`` counts estimates in a row that contradict ``bearings``; ``lens``
    is what was learnt of the camera matrix. ``two_view_skip`` is how many views to come need no
    estimate, since the map knows their geometry, and which ``wrong`` matches it found, by id; None
    where it does not. ``unlearnt`` is the last view, if its noise is yet to be learnt.
    """

    attitude: Attitude
    noise: float
    bearings: Bearings | None = None
    consecutive_rejections: int = 0
    lens: Lens = CALIBRATED
    two_view_skip: int = 0
    wrong: tuple[int, ...] | None = None
    unlearnt: Still | None = field(default=None, compare=False)


def fresh_memory(settings: PerceptionSettings) -> PerceptionMemory:
    """Return the memory before the first observation."""
    return PerceptionMemory(
        settings.mount,
        settings.pixel_noise,
        lens=unknown_lens(settings.focal_deviation),
    )


class Lesson(NamedTuple):
    """
    What one view may add to a ``memory``: its ``estimate``, rejected if there is a ``reason``.

    ``noise`` is the deviation [px] that its residuals show, ``parallax`` in pixels.
    """

    memory: PerceptionMemory
    estimate: Estimate
    reason: str
    noise: float
    parallax: float

    @property
    def informative(self) -> bool:
        """Whether it says something of the camera."""
        return not self.reason and self.parallax > INFORMATIVE_PARALLAX * self.noise


def updated_memories(lessons: Sequence[Lesson]) -> list[PerceptionMemory]:
    """Return the memories after lessons, one of each robot: none depends on the others."""
    attitudes = {
        k: (lesson.memory.attitude, lesson.estimate.attitude)
        for k, lesson in enumerate(lessons)
        if lesson.informative and lesson.estimate.attitude is not None
    }
    learnt_ones = dict(zip(attitudes, learnt_attitudes(list(attitudes.values())), strict=True))
    return [
        _after(lesson, learnt_ones.get(k, lesson.memory.attitude))
        for k, lesson in enumerate(lessons)
    ]


def _after(lesson: Lesson, attitude: Attitude) -> PerceptionMemory:
    """Return the memory after a ``lesson``, with the ``attitude`` as it is known then."""
    memory, estimate = lesson.memory, lesson.estimate
    if lesson.reason:
        return replace(memory, consecutive_rejections=memory.consecutive_rejections + 1)
    lens = learnt(memory.lens, estimate.lens) if lesson.informative else memory.lens
    return PerceptionMemory(attitude, lesson.noise, estimate.bearings, lens=lens)


def learnt_attitudes(pairs: Sequence[tuple[Attitude, Attitude]]) -> list[Attitude]:
    """
    Return the attitudes before, of one robot each, corrected by those of one more pair of views.

    Every pair has the same photograph: what its noise did to one estimate it does to the next as
    well. No number of pairs tells more than twice what one does.
    """
    if not pairs:
        return []
    moments = np.array([(before.moments, after.moments) for before, after in pairs])
    covariances, anew = _combined(moments[:, 0], moments[:, 1])
    return [
        replace(after, jitter=before.jitter)
        if is_anew
        else Attitude(after.tilt, after.roll, jitter=before.jitter).known_to(covariance)
        for (before, after), covariance, is_anew in zip(
            pairs, covariances, anew.tolist(), strict=True
        )
    ]


def _combined(before: FloatArray, after: FloatArray) -> tuple[FloatArray, BoolArray]:
    """
    Return covariances after one more pair of views, (B, 2, 2), and where it begins anew, (B,).

    There ``after`` was not estimated from what was known ``before``.
    """
    root = np.linalg.cholesky(before)
    # What this pair tells, in units of what was known, along directions that do not mix.
    told, axes = np.linalg.eigh(root.swapaxes(-2, -1) @ np.linalg.inv(after) @ root - IDENTITY)
    known = np.maximum(np.minimum(1.0 + told, 2.0 * told), 1.0)
    axes = root @ axes
    covariance = (axes / known[:, None, :]) @ axes.swapaxes(-2, -1)
    least = KNOWN_DEVIATION * KNOWN_DEVIATION
    for k in range(2):
        np.maximum(covariance[:, k, k], least, out=covariance[:, k, k])
    return covariance, told[:, 0] < -ROUNDING
