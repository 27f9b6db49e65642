"""
Delay of the base: how late it turns, learnt from what was commanded and what is seen.

Of each delay that may be, commands say which turn there should have been between two images; the
one whose turns fit those that are seen best is that of the base, be its wheels worn or not.
"""

from dataclasses import dataclass, field, replace
from functools import lru_cache
import math

import numpy as np

from visual_servo_epipolar.core.arrays import FloatArray
from visual_servo_epipolar.core.perception.measurement import Measurement
from visual_servo_epipolar.core.servo.commands_sent import CommandsSent
from visual_servo_epipolar.core.servo.identification.curvature import (
    heading_variance,
    LEAST_HEADING_VARIANCE,
)
from visual_servo_epipolar.core.servo.settings import ServoSettings
from visual_servo_epipolar.core.stamps import seconds_between

DELAYS: FloatArray = np.arange(31, dtype=np.float64) * 0.05  # [s]
BORNE = 0.25  # up to which laws bear a delay as it is [s]
MOST_DEVIATION = 0.01  # of a heading that tells a turn [rad]
LEAST_TURN = 2e-3  # between two images, seen or commanded [rad]
LEAST_POWER, LEAST_IMAGES = 0.01, 12  # sum of squared turns [rad^2], and images, that tell a delay
GAINS = 0.6, 1.6  # turns seen over turns commanded, of a base that obeys
UNEXPLAINED = 0.15  # most share of squared turns that the delay leaves
CLEARLY = 3.0  # times as much is left without it


@dataclass(frozen=True, eq=False)
class Delay:
    """
    Delay ``value`` [s], 0 until it is known.

    ``seen``, shape (31,), is the sum of turns seen times those commanded by DELAYS, ``power`` of
    the squares of the latter, ``energy`` of the former [rad^2], over ``images``.
    """

    value: float = 0.0
    seen: FloatArray = field(default_factory=lambda: np.zeros(len(DELAYS)))
    power: FloatArray = field(default_factory=lambda: np.zeros(len(DELAYS)))
    energy: float = 0.0
    images: int = 0

    def updated(
        self,
        previous: Measurement | None,
        measurement: Measurement,
        sent: CommandsSent,
        settings: ServoSettings,
    ) -> 'Delay':
        """Return the delay after one more image: by its turn since the ``previous`` one."""
        if previous is None or not _tells_a_turn(previous, measurement, settings):
            return self
        turn = math.remainder(measurement.heading_error - previous.heading_error, 2.0 * math.pi)
        turns = sent.turns(previous.stamp_ns, measurement.stamp_ns, DELAYS)
        if max(abs(turn), float(np.abs(turns).max())) < LEAST_TURN:
            return self
        after = replace(
            self,
            seen=self.seen + turn * turns,
            power=self.power + turns * turns,
            energy=self.energy + turn * turn,
            images=self.images + 1,
        )
        return replace(after, value=after._told(settings.latency))

    def _told(self, latency: float) -> float:
        """Return the delay that turns tell, the one before where they tell none for certain."""
        if self.images < LEAST_IMAGES:
            return self.value
        left = self.energy - self.seen**2 / np.maximum(self.power, 1e-12)
        left = np.where((self.seen > 0.0) & (self.power >= LEAST_POWER), left, self.energy)
        best = int(left.argmin())
        usual = left[DELAYS <= max(latency, BORNE)].min()
        gain = self.seen[best] / max(self.power[best], 1e-12)
        fits = left[best] <= UNEXPLAINED * self.energy and GAINS[0] < gain < GAINS[1]
        if not fits or usual < CLEARLY * left[best]:
            return self.value
        return float(DELAYS[best])

    def beside(self, settings: ServoSettings) -> ServoSettings:
        """Return ``settings`` with the delay that was learnt, where it is longer."""
        if not settings.options.anticipation or self.value <= settings.latency:
            return settings
        return _with_latency(settings, self.value)


def _tells_a_turn(
    previous: Measurement, measurement: Measurement, settings: ServoSettings
) -> bool:
    """Return whether both headings are known, by the same views, and no image lies between."""
    if previous.remembered is not measurement.remembered:
        return False
    gap = seconds_between(previous.stamp_ns, measurement.stamp_ns)
    if not 0.0 < gap <= settings.stale_timeout:
        return False
    return max(_deviation(previous), _deviation(measurement)) <= MOST_DEVIATION


def _deviation(measurement: Measurement) -> float:
    """Return the deviation of the heading error [rad]; inf where it is not known."""
    if math.isfinite(measurement.heading_deviation):
        return measurement.heading_deviation
    if measurement.bearings is None:
        return math.inf
    return math.sqrt(max(heading_variance(measurement), LEAST_HEADING_VARIANCE))


@lru_cache(maxsize=64)
def _with_latency(settings: ServoSettings, latency: float) -> ServoSettings:
    return replace(settings, latency=latency)
