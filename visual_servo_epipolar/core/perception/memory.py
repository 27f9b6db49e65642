"""What perception carries from frame to frame: the camera's attitude, noise, the last bearings."""

from dataclasses import dataclass, replace

import numpy as np

from visual_servo_epipolar.core.estimators.base import Attitude, Estimate
from visual_servo_epipolar.core.geometry.epipolar import Bearings
from visual_servo_epipolar.core.geometry.lens import CALIBRATED, learnt, Lens, unknown_lens
from visual_servo_epipolar.core.perception.settings import PerceptionSettings

KNOWN_DEVIATION = 1.7e-3  # of tilt and roll: the floor moved the desired camera, too [rad]
ROUNDING = 0.05  # of information, in units of what was known
INFORMATIVE_PARALLAX = 12.0  # in deviations of the noise: bearings to about three degrees


@dataclass(frozen=True, slots=True)
class PerceptionMemory:
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


def fresh_memory(settings: PerceptionSettings) -> PerceptionMemory:
    """Return the memory before the first observation."""
    return PerceptionMemory(
        settings.mount,
        settings.pixel_noise,
        lens=unknown_lens(settings.focal_deviation),
    )


def updated_memory(
    memory: PerceptionMemory, estimate: Estimate, reason: str, *, noise: float, parallax: float
) -> PerceptionMemory:
    """
    Return the memory after ``estimate``, which was rejected if there is a ``reason``.

    ``noise`` is the deviation [px] that its residuals show, ``parallax`` in pixels.
    """
    if reason:
        return replace(memory, consecutive_rejections=memory.consecutive_rejections + 1)
    attitude, lens = memory.attitude, memory.lens
    informative = parallax > INFORMATIVE_PARALLAX * noise
    if informative:
        lens = learnt(lens, estimate.lens)
    if informative and estimate.attitude is not None:
        attitude = learnt_attitude(attitude, estimate.attitude)
    return PerceptionMemory(attitude, noise, estimate.bearings, lens=lens)


def learnt_attitude(before: Attitude, after: Attitude) -> Attitude:
    """
    Return what is known of the attitude ``after`` one more pair of views.

    Every pair has the same photograph: what its noise did to one estimate it does to the next as
    well. No number of pairs tells more than twice what one does.
    """
    root = np.linalg.cholesky(before.covariance)
    # What this pair tells, in units of what was known, along directions that do not mix.
    told, axes = np.linalg.eigh(root.T @ np.linalg.inv(after.covariance) @ root - np.eye(2))
    if told.min() < -ROUNDING:  # it was not estimated from what was known before, but anew
        return replace(after, jitter=before.jitter)
    known = np.maximum(np.minimum(1.0 + told, 2.0 * told), 1.0)
    axes = root @ axes
    covariance = (axes / known) @ axes.T
    least = KNOWN_DEVIATION * KNOWN_DEVIATION
    np.fill_diagonal(covariance, np.maximum(covariance.diagonal(), least))
    return replace(after, jitter=before.jitter).known_to(covariance)
