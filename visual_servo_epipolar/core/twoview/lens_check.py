"""
Lens check: whether the tracks agree with the configured focal length; if not, a warning.

Now and then the focal length of a calibrated camera is estimated as if it were uncalibrated, and
must agree with the configured one. The run uses the latter all the same: a calibration is
usually better than a few views.
"""

from dataclasses import dataclass, replace
from functools import lru_cache
import math

import numpy as np

from visual_servo_epipolar.core.geometry.epipolar import cross_matrix
from visual_servo_epipolar.core.geometry.least_squares import null_vector
from visual_servo_epipolar.core.geometry.lens import Lens, unknown_lens
from visual_servo_epipolar.core.geometry.rays import normalised
from visual_servo_epipolar.core.reasons import Reason
from visual_servo_epipolar.core.twoview.measurement import Measurement
from visual_servo_epipolar.core.twoview.memory import PerceptionMemory
from visual_servo_epipolar.core.twoview.observation import Observation
from visual_servo_epipolar.core.twoview.perceive import perceive
from visual_servo_epipolar.core.twoview.registry import DEFAULT_ESTIMATOR
from visual_servo_epipolar.core.twoview.settings import PerceptionSettings

PERIOD = 10  # frames from one look to the next
UNKNOWN = 0.3  # deviation of the logarithm of the focal length, as one begins
# Deviations that contradict, and what matters: docs/calibration.md has the figures.
CONTRADICTION, LEAST = 5.0, 0.03
LEAST_OF_PAIR = 0.3  # likewise where two views alone say so: by a fifth they may err
PLANE_PX, PLANE_SHARE, PLANE_ROUNDS = 2.0, 0.8, 5  # of a homography, and features that fit it


@dataclass(frozen=True, slots=True)
class LensCheck:
    """Result so far: the ``memory`` of the looks, and the ``doubt`` to be logged, or ''."""

    memory: PerceptionMemory | None = None
    doubt: str = ''


def looked_at(
    before: LensCheck,
    observation: Observation,
    run: tuple[Measurement, PerceptionMemory],
    settings: PerceptionSettings,
    frame: int,
) -> LensCheck:
    """
    Return the check after one more view, of which ``run`` is what the run has measured.

    It begins from there: a first look from nothing takes half a second, these two or three views.
    """
    measurement, known = run
    due = settings.calibrated and not observation.wide and frame % PERIOD == 0
    if not due or measurement.bearings is None or known.bearings is None:
        return before
    memory = before.memory
    if memory is None or known.shutter.contradicts(settings.readout) != (
        memory.shutter.contradicts(settings.readout)
    ):  # a rolling shutter bends rays as another focal length does
        memory = replace(known, lens=unknown_lens(UNKNOWN))
    observation = observation.at_one_instant(known.shutter.turn(settings.readout))
    memory = replace(
        memory,
        bearings=known.bearings,
        consecutive_rejections=0,
        two_view_skip=0,
        wrong=None,
        shutter=known.shutter,
    )
    memory = perceive(observation, uncalibrated(settings), frame, memory).memory
    doubt = _contradiction(memory.lens, observation.focal)
    if doubt:
        doubt = f'the tracks contradict camera_info: {doubt}, or set focal_deviation: 0.3'
    return LensCheck(memory, doubt)


def contradicted_by_pair(observation: Observation, settings: PerceptionSettings) -> str:
    """
    Return that two views alone contradict the configured focal length, or ''.

    Views of one plane tell nothing: a tilt looks like another focal length there. Nor do fewer
    features than two views need, as where a memory of views carries on.
    """
    few = len(observation) < settings.min_features
    if few or not settings.calibrated or observation.wide or _shows_one_plane(observation):
        return ''
    lens = perceive(observation, uncalibrated(settings), 0).memory.lens
    doubt = _contradiction(lens, observation.focal, LEAST_OF_PAIR)
    return Reason.OTHER_LENS.of(doubt) if doubt else ''


def _shows_one_plane(observation: Observation) -> bool:
    """Return whether one homography takes most features from view to view."""
    current, desired = observation.current, observation.desired
    # desired x (H current) = 0, linear in H
    rows = (cross_matrix(desired)[..., None] * current[:, None, None, :]).reshape(-1, 9)
    weights = np.ones(len(current))
    for _ in range(PLANE_ROUNDS):
        homography = null_vector(rows, np.repeat(weights, 3)).reshape(3, 3)
        carried = normalised(current @ homography.T)
        aside = np.linalg.norm(np.cross(carried, desired), axis=1)
        misses = aside / observation.resolution[:, 1]
        weights = (misses <= max(PLANE_PX, 2.0 * float(np.median(misses)))).astype(np.float64)
    return float((misses <= PLANE_PX).mean()) > PLANE_SHARE


def _contradiction(lens: Lens, focal: float, least: float = LEAST) -> str:
    """Return how far a learnt lens is from the configured ``focal`` length [px], or ''."""
    off = lens.log_ratio
    if abs(off) < max(CONTRADICTION * lens.ratio_deviation, least):
        return ''
    return (
        f'a focal length of {focal:.0f} px, and they say {focal * math.exp(-off):.0f} px; '
        'calibrate at the resolution in use'
    )


@lru_cache(maxsize=4)
def uncalibrated(settings: PerceptionSettings) -> PerceptionSettings:
    """Return ``settings`` of an uncalibrated camera; to check them takes long."""
    return replace(settings, estimator=DEFAULT_ESTIMATOR, focal_deviation=UNKNOWN)
