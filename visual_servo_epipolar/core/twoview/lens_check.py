"""
Lens check: whether two views contradict the configured focal length of a calibrated camera.

It is estimated as if the camera were uncalibrated.
"""

from dataclasses import replace
from functools import lru_cache
import math

import numpy as np

from visual_servo_epipolar.core.arrays import FloatArray
from visual_servo_epipolar.core.geometry.epipolar import cross_matrix
from visual_servo_epipolar.core.geometry.least_squares import null_vector
from visual_servo_epipolar.core.geometry.rays import normalised
from visual_servo_epipolar.core.reasons import Reason
from visual_servo_epipolar.core.twoview.observation import Observation
from visual_servo_epipolar.core.twoview.perceive import perceive
from visual_servo_epipolar.core.twoview.registry import DEFAULT_ESTIMATOR
from visual_servo_epipolar.core.twoview.settings import PerceptionSettings

UNKNOWN = 0.3  # deviation of the logarithm of the focal length, as one begins
CONTRADICTION, LEAST = 5.0, 0.3  # deviations that contradict; by a fifth two views may err
PLANE_PX, PLANE_SHARE, PLANE_ROUNDS = 2.0, 0.8, 5  # of a homography, and features that fit it


def contradicted_by_pair(
    observation: Observation, settings: PerceptionSettings
) -> tuple[str, FloatArray | None]:
    """
    Return that two views alone contradict the configured focal length, or '', and E by another.

    Views of one plane tell nothing: a tilt looks like another focal length there. Nor do fewer
    features than two views need, as where a memory of views carries on.
    """
    few = len(observation) < settings.min_features
    if few or not settings.calibrated or observation.wide or _shows_one_plane(observation):
        return '', None
    found, focal = perceive(observation, uncalibrated(settings), 0), observation.focal
    lens = found.memory.lens
    if abs(lens.log_ratio) < max(CONTRADICTION * lens.ratio_deviation, LEAST):
        return '', None
    reason = Reason.OTHER_LENS.of(
        f'a focal length of {focal:.0f} px, and they say '
        f'{focal * math.exp(-lens.log_ratio):.0f} px; calibrate at the resolution in use'
    )
    return reason, found.fundamental


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


@lru_cache(maxsize=4)
def uncalibrated(settings: PerceptionSettings) -> PerceptionSettings:
    """Return ``settings`` of an uncalibrated camera; to check them takes long."""
    return replace(settings, estimator=DEFAULT_ESTIMATOR, focal_deviation=UNKNOWN)
