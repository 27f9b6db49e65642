"""When an estimate is worth nothing: the reasons not to act on it."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
import math
from typing import NamedTuple

import numpy as np

from visual_servo_epipolar.core.arrays import BoolArray, FloatArray, median_of_sorted
from visual_servo_epipolar.core.estimators.base import Attitude, Estimate
from visual_servo_epipolar.core.geometry.epipolar import Bearings, sampson_distance
from visual_servo_epipolar.core.geometry.lens import CALIBRATED, learnt, Lens, unknown_lens
from visual_servo_epipolar.core.geometry.rays import image_points
from visual_servo_epipolar.core.servo.settings import ServoSettings

MIN_INLIERS = 8
MAX_JUMP = 12.0  # of tilt and roll between the views, in deviations of the floor's jitter
MIN_INLIER_SHARE = 0.3
STRIKES = 3  # frames in a row that contradict the past before the past is given up
KNOWN_DEVIATION = 1.7e-3  # of tilt and roll: the floor moved the desired camera, too [rad]
INFORMATIVE_PARALLAX = 12.0  # in deviations of the noise: bearings to about three degrees


@dataclass(frozen=True, slots=True)
class Memory:
    """
    What perception carries from frame to frame.

    ``attitude`` is the camera's, calibrated while driving; ``bearings`` the last trusted ones;
    ``noise`` the deviation of a tracked coordinate [px] as the residuals show it;
    ``consecutive_rejections`` counts estimates in a row that contradict ``bearings``; ``lens``
    is what was learnt of the camera matrix.
    """

    attitude: Attitude
    noise: float
    bearings: Bearings | None = None
    consecutive_rejections: int = 0
    lens: Lens = CALIBRATED


def fresh_memory(settings: ServoSettings) -> Memory:
    """Return the memory of a servo that has seen nothing yet."""
    return Memory(
        Attitude(jitter=settings.floor_jitter),
        settings.pixel_noise,
        lens=unknown_lens(settings.focal_deviation),
    )


def innovation(bearings: Bearings, before: Bearings) -> float:
    """Return by how much bearings changed [rad], the larger of the two."""
    psi = abs(math.remainder(bearings.psi - before.psi, 2.0 * math.pi))
    return max(psi, abs(math.remainder(bearings.phi - before.phi, 2.0 * math.pi)))


class Evidence(NamedTuple):
    """
    What speaks for an estimate.

    Number of ``inliers``, their ``spread`` [rad], the larger ``deviation`` of psi and phi [rad],
    nan if there is none, and the median ``residual`` of all matches [px].
    """

    inliers: int
    spread: float
    deviation: float
    residual: float


def evidence(
    estimates: Sequence[Estimate],
    current: FloatArray,
    desired: FloatArray,
    resolution: FloatArray,
) -> list[Evidence]:
    """
    Return what speaks for ``estimates`` from as many pairs of views.

    Unit rays have shape (B, N, 3), the angles of a pixel at them (B, N, 2).
    """
    inliers = np.array([estimate.inliers for estimate in estimates])
    fundamental = np.array([estimate.fundamental for estimate in estimates])
    covariance = np.array([estimate.covariance for estimate in estimates])
    variance = np.maximum(covariance[:, 0, 0], covariance[:, 1, 1])
    residual = np.sort(np.abs(sampson_distance(fundamental, current, desired, resolution)), axis=1)
    return list(
        map(
            Evidence,
            np.count_nonzero(inliers, axis=1).tolist(),
            spreads(image_points(desired), inliers).tolist(),
            np.sqrt(np.maximum(variance, 0.0)).tolist(),
            median_of_sorted(residual).tolist(),
        )
    )


def spreads(rays: FloatArray, inliers: BoolArray) -> FloatArray:
    """
    Return how far apart the ``inliers``, shape (B, N), among ``rays``, (B, N, 2), are, shape (B,).

    It is the fourth root of the determinant of their covariance: the geometric mean of their
    deviations along two axes.
    """
    count = np.maximum(inliers.sum(axis=1), 2)
    x, y = np.where(inliers, rays[:, :, 0], 0.0), np.where(inliers, rays[:, :, 1], 0.0)
    x = np.where(inliers, x - (x.sum(axis=1) / count)[:, None], 0.0)
    y = np.where(inliers, y - (y.sum(axis=1) / count)[:, None], 0.0)
    determinant = (x * x).sum(axis=1) * (y * y).sum(axis=1) - (x * y).sum(axis=1) ** 2
    return np.asarray((np.maximum(determinant, 0.0) / (count - 1.0) ** 2) ** 0.25)


def rejection_reason(
    estimate: Estimate, shown: Evidence, memory: Memory, settings: ServoSettings
) -> str:
    """Return why ``estimate`` is not to be trusted, in words; empty if it is."""
    inliers, count, spread = shown.inliers, len(estimate.inliers), shown.spread
    if inliers < max(MIN_INLIERS, MIN_INLIER_SHARE * count):
        return f'only {inliers} of {count} matches agree on one geometry'
    if spread < settings.min_spread:
        return f'the features are clustered within {math.degrees(spread):.1f} deg'
    if estimate.confidence < settings.min_confidence:
        return f'the cheirality vote is undecided ({estimate.confidence:.3f})'
    if estimate.jump > MAX_JUMP * settings.floor_jitter:
        return f'the camera tilted by {math.degrees(estimate.jump):.1f} deg between the views'
    uncertain = shown.deviation
    if uncertain > settings.max_deviation:
        return f'the bearings are uncertain by {math.degrees(uncertain):.1f} deg'
    if memory.bearings is None:
        if estimate.alternative is not None:
            return 'two geometries fit the features: one plane dominates the scene'
        return ''
    change = innovation(estimate.bearings, memory.bearings)
    if change > settings.max_leap and memory.consecutive_rejections + 1 < STRIKES:
        return f'the bearings leapt by {math.degrees(change):.1f} deg in one frame'
    return ''


def remembered(
    memory: Memory, estimate: Estimate, reason: str, *, noise: float, parallax: float
) -> Memory:
    """
    Return the memory after ``estimate``, which is trusted unless there is a ``reason``.

    ``noise`` is the deviation [px] that its residuals show, ``parallax`` in pixels.
    """
    if reason:
        return replace(memory, consecutive_rejections=memory.consecutive_rejections + 1)
    attitude, lens = memory.attitude, memory.lens
    if parallax > INFORMATIVE_PARALLAX * noise:
        lens = learnt(lens, estimate.lens)
    if estimate.attitude is not None and parallax > INFORMATIVE_PARALLAX * noise:
        found = estimate.attitude
        attitude = Attitude(
            found.tilt,
            found.roll,
            max(found.tilt_deviation, KNOWN_DEVIATION),
            max(found.roll_deviation, KNOWN_DEVIATION),
            attitude.jitter,
        )
    return Memory(attitude, noise, estimate.bearings, lens=lens)
