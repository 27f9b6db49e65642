"""
Whether the tracks go with the focal length that was told: a doubt that is said, and no more.

A camera that counts as calibrated is looked at now and then as if nobody had calibrated it. What
is learnt of its focal length must agree with what was told. The run goes by what was told all the
same: who calibrated knows better than a few views, more often than not.
"""

from dataclasses import dataclass, replace
from functools import lru_cache
import math

from visual_servo_epipolar.core.estimators.registry import DEFAULT_ESTIMATOR
from visual_servo_epipolar.core.geometry.lens import unknown_lens
from visual_servo_epipolar.core.perception.measurement import Measurement
from visual_servo_epipolar.core.perception.memory import PerceptionMemory
from visual_servo_epipolar.core.perception.observation import Observation
from visual_servo_epipolar.core.perception.perceive import perceive
from visual_servo_epipolar.core.perception.settings import PerceptionSettings

PERIOD = 10  # frames from one look to the next
UNKNOWN = 0.3  # deviation of the logarithm of the focal length, as one begins
# Deviations that contradict, and what matters: docs/calibration.md has the figures.
CONTRADICTION, LEAST = 5.0, 0.03


@dataclass(frozen=True, slots=True)
class LensCheck:
    """What was learnt: the ``memory`` of the looks so far, and the ``doubt`` to be said, or ''."""

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
    Return the check after one more view, of which ``run`` is what the run measured and knows.

    It begins from there: a first look from nothing takes half a second, these two or three views.
    """
    measurement, known = run
    due = settings.calibrated and not observation.wide and frame % PERIOD == 0
    if not due or measurement.bearings is None or known.bearings is None:
        return before
    memory = before.memory or replace(known, lens=unknown_lens(UNKNOWN))
    memory = replace(
        memory, bearings=known.bearings, consecutive_rejections=0, spared=0, wrong=None
    )
    memory = perceive(observation, _uncalibrated(settings), frame, memory).memory
    off, deviation = memory.lens.log_ratio, memory.lens.ratio_deviation
    if abs(off) < max(CONTRADICTION * deviation, LEAST):
        return LensCheck(memory)
    return LensCheck(
        memory,
        f'the tracks contradict camera_info: a focal length of {observation.focal:.0f} px, and '
        f'they say {observation.focal * math.exp(-off):.0f} px; calibrate at the resolution in '
        'use, or set focal_deviation: 0.3',
    )


@lru_cache(maxsize=4)
def _uncalibrated(settings: PerceptionSettings) -> PerceptionSettings:
    """Return ``settings`` of a camera that nobody calibrated; to check them takes long."""
    return replace(settings, estimator=DEFAULT_ESTIMATOR, focal_deviation=UNKNOWN)
