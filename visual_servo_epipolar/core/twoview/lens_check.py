"""
Lens check: whether two views contradict the configured focal length of a calibrated camera.

It is estimated as if the camera were uncalibrated.
"""

from dataclasses import replace
from functools import lru_cache
import math

from visual_servo_epipolar.core.arrays import FloatArray
from visual_servo_epipolar.core.reasons import Reason
from visual_servo_epipolar.core.tracking.robust_geometry import share_on_plane
from visual_servo_epipolar.core.twoview.observation import Observation
from visual_servo_epipolar.core.twoview.perceive import perceive
from visual_servo_epipolar.core.twoview.registry import DEFAULT_ESTIMATOR
from visual_servo_epipolar.core.twoview.settings import PerceptionSettings

UNKNOWN = 0.3  # deviation of the logarithm of the focal length, as one begins: less is no doubt
CONTRADICTION = 5.0  # deviations
PLANE_SHARE = 0.8  # of the features, that one homography fits


def contradicted_by_pair(
    observation: Observation, settings: PerceptionSettings
) -> tuple[str, FloatArray | None]:
    """
    Return that two views alone contradict the configured focal length, or '', and E by another.

    Views of one plane tell nothing: a tilt looks like another focal length there. Nor do fewer
    features than two views need, as where a memory of views carries on.
    """
    few = len(observation) < settings.min_features
    if few or not settings.calibrated or observation.wide:
        return '', None
    focal = observation.focal
    if share_on_plane(observation.current, observation.desired, 1.0 / focal) > PLANE_SHARE:
        return '', None
    found = perceive(observation, uncalibrated(settings), 0)
    lens = found.memory.lens
    if abs(lens.log_ratio) < max(CONTRADICTION * lens.ratio_deviation, UNKNOWN):
        return '', None
    reason = Reason.OTHER_LENS.of(
        f'a focal length of {focal:.0f} px, and they say '
        f'{focal * math.exp(-lens.log_ratio):.0f} px; calibrate at the resolution in use'
    )
    return reason, found.fundamental


@lru_cache(maxsize=4)
def uncalibrated(settings: PerceptionSettings) -> PerceptionSettings:
    """Return ``settings`` of an uncalibrated camera; to check them takes long."""
    return replace(settings, estimator=DEFAULT_ESTIMATOR, focal_deviation=UNKNOWN)
