"""What is seen of the goal: the values that perception takes and gives."""

from dataclasses import dataclass, field, replace
import math
from typing import NamedTuple

import numpy as np

from visual_servo_epipolar.core.arrays import FloatArray
from visual_servo_epipolar.core.estimators.base import UNKNOWN_COVARIANCE
from visual_servo_epipolar.core.geometry.epipolar import Bearings
from visual_servo_epipolar.core.geometry.lens import CALIBRATED, corrected, Lens
from visual_servo_epipolar.core.geometry.motion import HALF_PI
from visual_servo_epipolar.core.perception.validation import Memory
from visual_servo_epipolar.core.servo.settings import ServoSettings


@dataclass(frozen=True, slots=True, eq=False)
class Observation:
    """
    One set of matches as unit rays, shape (N, 3) each, taken at ``stamp_ns``.

    ``pixel_angles``, shape (N, 2), are those of a pixel at current and desired rays [rad]: None
    where the camera is a pinhole without distortion.
    ``focal`` [px] only turns pixel thresholds into angles and back. ``edges`` are the bearings of
    the left and the right edge of the image [rad], right positive.
    """

    stamp_ns: int
    current: FloatArray
    desired: FloatArray
    focal: float
    edges: tuple[float, float] = (-HALF_PI, HALF_PI)
    pixel_angles: FloatArray | None = None

    @property
    def resolution(self) -> FloatArray:
        """Angle of a pixel at each current and desired ray [rad], shape (N, 2)."""
        if self.pixel_angles is not None:
            return self.pixel_angles
        forward = np.stack([self.current[:, 2], self.desired[:, 2]], axis=1)
        return np.asarray(forward**1.5 / self.focal)

    def corrected(self, lens: Lens) -> 'Observation':
        """Return the observation without what is wrong with the camera matrix."""
        if lens.corrects_nothing:
            return self
        ratio = math.exp(lens.log_ratio)
        current, growth_current = corrected(self.current, lens)
        desired, growth_desired = corrected(self.desired, lens)
        left, right = (math.atan(ratio * math.tan(edge) + lens.shift) for edge in self.edges)
        return replace(
            self,
            current=current,
            desired=desired,
            focal=self.focal / ratio,
            pixel_angles=self.resolution * np.stack([growth_current, growth_desired], axis=1),
            edges=(left, right),
        )


@dataclass(frozen=True, slots=True, eq=False)
class Measurement:
    """
    What one observation tells about the goal, at unit focal length.

    ``bearings`` is None where they cannot be trusted, and ``reason`` says why. ``difference`` is D
    of eq. (23), averaged over the features, ``difference_deviation`` its noise; ``feature_error``
    the median distance of current from desired features; ``parallax`` what the best rotation
    leaves unexplained; ``heading_error`` comes from the bearings where there are any, else from
    that rotation. ``deviation`` is the larger one of psi and phi, ``covariance`` that of both,
    shape (2, 2), ``jump`` the change of tilt and roll between the views [rad]; ``room`` is how far
    the robot may turn to the left and to the right before the features run out of the image [rad];
    ``memory`` is for the next frame.
    """

    stamp_ns: int
    features: int
    focal: float
    memory: Memory
    bearings: Bearings | None = None
    deviation: float = math.nan
    covariance: FloatArray = field(default_factory=lambda: UNKNOWN_COVARIANCE)
    jump: float = 0.0
    confidence: float = 0.0
    inliers: int = 0
    parallax: float = math.nan
    heading_error: float = math.nan
    difference: float = math.nan
    difference_deviation: float = math.nan
    feature_error: float = math.nan
    room: tuple[float, float] = (math.inf, math.inf)
    reason: str = ''

    @property
    def noise(self) -> float:
        """Deviation of a coordinate at unit focal length, as the residuals show it."""
        return self.memory.noise / self.focal

    @property
    def parallax_px(self) -> float:
        """Parallax in pixels."""
        return self.parallax * self.focal


class Glimpse(NamedTuple):
    """
    What is needed to perceive: matches, and what was known before them.

    ``frame`` numbers the observations of a run: with the seed it fixes every random choice.
    ``memory`` is that of the last Measurement, None before the first.
    """

    observation: Observation
    settings: ServoSettings
    frame: int
    memory: Memory | None = None

    @property
    def lens(self) -> Lens:
        """What was known of the camera matrix."""
        return CALIBRATED if self.memory is None else self.memory.lens

    def corrected(self, lens: Lens) -> 'Glimpse':
        """Return the same as it would be without what is wrong with the camera matrix."""
        if lens.corrects_nothing:
            return self
        return self._replace(observation=self.observation.corrected(lens))

    @classmethod
    def after(
        cls,
        measurement: Measurement | None,
        observation: Observation,
        settings: ServoSettings,
        frame: int,
    ) -> 'Glimpse':
        """Return the glimpse that follows the last Measurement, None before the first."""
        return cls(
            observation, settings, frame, None if measurement is None else measurement.memory
        )
