"""Memory of perception from frame to frame: the camera's attitude, noise, the last bearings."""

from dataclasses import dataclass, field, replace
from typing import NamedTuple

import numpy as np

from visual_servo_epipolar.core.arrays import FloatArray
from visual_servo_epipolar.core.geometry.epipolar import Bearings
from visual_servo_epipolar.core.geometry.lens import CALIBRATED, learnt, Lens, unknown_lens
from visual_servo_epipolar.core.twoview.estimator import Attitude, Estimate
from visual_servo_epipolar.core.twoview.observation import Observation
from visual_servo_epipolar.core.twoview.rivals import Rivals
from visual_servo_epipolar.core.twoview.rolling_shutter import RollingShutter
from visual_servo_epipolar.core.twoview.settings import PerceptionSettings

KNOWN_DEVIATION = 1.7e-3  # of tilt and roll: the floor moved the desired camera, too [rad]
MAX_REJECTIONS = 3  # estimates in a row that contradict the past before the past is given up
ROUNDING = 0.05  # of information, in units of what was known
INFORMATIVE_PARALLAX = 12.0  # in deviations of the noise: bearings to about three degrees
IDENTITY = np.eye(2)


class Still(NamedTuple):
    """View without a baseline, its best ``rotation``, (3, 3), and the noise to begin with [px]."""

    observation: Observation
    rotation: FloatArray
    first_noise: float


@dataclass(frozen=True)
class PerceptionMemory:
    """
    What perception carries from frame to frame.

    ``attitude`` is the camera's, calibrated while driving, its jitter what the floor has shown;
    ``bearings`` the last trusted ones;
    ``noise`` the deviation of a tracked coordinate [px] as the residuals show it;
    ``consecutive_rejections`` counts estimates in a row that contradict ``bearings``; ``lens``
    is what was learnt of the camera matrix. ``two_view_skip`` is how many views to come need no
    estimate, since the map has their geometry, and which ``wrong`` matches it found, by id; None
    where it does not. ``rivals`` are both geometries before a plane, until the way has ``decided``
    which is right; ``unlearnt`` is the last view, if its noise is yet to be learnt; ``shutter`` is
    what images show of its readout.
    """

    attitude: Attitude
    noise: float
    bearings: Bearings | None = None
    consecutive_rejections: int = 0
    lens: Lens = CALIBRATED
    two_view_skip: int = 0
    wrong: tuple[int, ...] | None = None
    rivals: Rivals | None = None
    decided: bool = False
    unlearnt: Still | None = field(default=None, compare=False)
    shutter: RollingShutter = field(default=RollingShutter(), compare=False)

    def mount_by(self, settings: PerceptionSettings) -> Attitude:
        """Return what ``settings`` say of the attitude, on the floor that was seen since."""
        return replace(settings.mount, jitter=self.attitude.jitter)


def fresh_memory(settings: PerceptionSettings) -> PerceptionMemory:
    """Return the memory before the first observation."""
    return PerceptionMemory(
        settings.mount, settings.pixel_noise, lens=unknown_lens(settings.focal_deviation)
    )


def updated_memory(
    memory: PerceptionMemory, estimate: Estimate, reason: str, *, noise: float, parallax: float
) -> PerceptionMemory:
    """
    Return the memory after an ``estimate``, which was rejected if there is a ``reason``.

    ``noise`` is the deviation [px] that its residuals show; what is shown with too small a
    ``parallax`` [px] says nothing of the camera.
    """
    if reason:
        count = memory.consecutive_rejections + 1
        is_decided = memory.decided and count < MAX_REJECTIONS
        return replace(memory, consecutive_rejections=count, decided=is_decided)
    attitude, lens = memory.attitude, memory.lens
    if parallax > INFORMATIVE_PARALLAX * noise:
        lens = learnt(lens, estimate.lens)
        if estimate.attitude is not None:
            attitude = learnt_attitude(attitude, estimate.attitude)
    return PerceptionMemory(
        attitude,
        noise,
        estimate.bearings,
        lens=lens,
        rivals=memory.rivals,
        decided=memory.decided,
        shutter=memory.shutter,
    )


def learnt_attitude(before: Attitude, after: Attitude) -> Attitude:
    """
    Return the attitude as it was known ``before``, corrected by that of one more pair of views.

    Every pair has the same photograph: what its noise did to one estimate it does to the next as
    well. No number of pairs tells more than twice what one does.
    """
    root = np.linalg.cholesky(before.covariance)
    # What this pair tells, in units of what was known, along directions that do not mix.
    gain, axes = np.linalg.eigh(root.T @ np.linalg.inv(after.covariance) @ root - IDENTITY)
    if not gain[0] < -ROUNDING:  # or it was not estimated from what was known before
        known = np.maximum(np.minimum(1.0 + gain, 2.0 * gain), 1.0)
        axes = root @ axes
        covariance = (axes / known) @ axes.T
        least = KNOWN_DEVIATION * KNOWN_DEVIATION
        for k in range(2):
            covariance[k, k] = max(covariance[k, k], least)
        after = after.known_to(covariance)
    return replace(after, jitter=before.jitter)
