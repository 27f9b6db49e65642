"""What perception carries from frame to frame: the camera's attitude, noise, the last bearings."""

from dataclasses import dataclass, replace

from visual_servo_epipolar.core.estimators.base import Attitude, Estimate
from visual_servo_epipolar.core.geometry.epipolar import Bearings
from visual_servo_epipolar.core.geometry.lens import CALIBRATED, learnt, Lens, unknown_lens
from visual_servo_epipolar.core.perception.settings import PerceptionSettings

KNOWN_DEVIATION = 1.7e-3  # of tilt and roll: the floor moved the desired camera, too [rad]
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
        Attitude(jitter=settings.floor_jitter),
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
        estimated = estimate.attitude
        attitude = Attitude(
            estimated.tilt,
            estimated.roll,
            max(estimated.tilt_deviation, KNOWN_DEVIATION),
            max(estimated.roll_deviation, KNOWN_DEVIATION),
            attitude.jitter,
        )
    return PerceptionMemory(attitude, noise, estimate.bearings, lens=lens)
