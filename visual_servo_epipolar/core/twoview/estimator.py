"""Estimator: its inputs, its result and its protocol."""

from dataclasses import dataclass
import math
from typing import Protocol

import numpy as np

from visual_servo_epipolar.core.arrays import BoolArray, FloatArray
from visual_servo_epipolar.core.geometry.epipolar import Bearings
from visual_servo_epipolar.core.geometry.lens import CALIBRATED, Lens

MOST_CORRELATED = 0.9999  # a covariance beyond it is singular but for rounding
BLUR_SHARE = 0.7  # of the jitter that shows as noise where jumps are not estimated
LEAST_JITTER = 1e-4  # of what a floor adds, that estimators take it for [rad]
COLD_DEVIATION = math.radians(2.0)  # of tilt and roll of an uncalibrated camera


@dataclass(frozen=True, slots=True)
class Attitude:
    """
    Tilt (down positive) and roll (clockwise) of the camera [rad], and how well they are known.

    Both views share them; ``jitter`` is the deviation of what an uneven floor adds to each.
    ``correlation`` is that of what is unknown of tilt and of roll.
    """

    tilt: float = 0.0
    roll: float = 0.0
    tilt_deviation: float = COLD_DEVIATION
    roll_deviation: float = COLD_DEVIATION
    jitter: float = math.radians(0.1)
    correlation: float = 0.0

    @property
    def blur(self) -> float:
        """Noise of angles [rad] that the jitter adds where jumps are not estimated."""
        return BLUR_SHARE * self.jitter

    @property
    def covariance(self) -> FloatArray:
        """Covariance of tilt and roll, shape (2, 2) [rad^2]."""
        tilt, roll = self.tilt_deviation, self.roll_deviation
        both = self.correlation * tilt * roll
        return np.array([[tilt * tilt, both], [both, roll * roll]])

    def known_to(self, covariance: FloatArray) -> 'Attitude':
        """Return the attitude with another ``covariance`` of tilt and roll, (2, 2) [rad^2]."""
        (tilt, both), (_, roll) = covariance.tolist()
        deviations = math.sqrt(tilt), math.sqrt(roll)
        bound = deviations[0] * deviations[1]
        correlation = min(max(both / bound, -MOST_CORRELATED), MOST_CORRELATED)
        return Attitude(self.tilt, self.roll, *deviations, self.jitter, correlation)


@dataclass(frozen=True, slots=True)
class Prior:
    """
    What is known before a pair of views is looked at.

    Of ``lens`` the deviations count: rays come as right as is known. ``mount`` is what was known
    of the attitude before anything was seen, to which an estimator returns when what has been
    learnt since fits no more; ``decided`` whether the bearings are the true ones before a plane.
    """

    attitude: Attitude = Attitude()
    bearings: Bearings | None = None  # the last trusted ones, carried along
    deviation: float = math.radians(3.0)  # how far the bearings may have moved since [rad]
    lens: Lens = CALIBRATED
    mount: Attitude | None = None
    decided: bool = False

    @property
    def angles(self) -> FloatArray:
        """The last psi and phi, shape (2,), nan where there are none."""
        if self.bearings is None:
            return np.full(2, np.nan)
        return np.array([self.bearings.psi, self.bearings.phi])


@dataclass(frozen=True, slots=True, eq=False)
class Estimate:
    """
    Epipolar geometry of one pair of views, from unit rays.

    ``inliers`` has shape (N,); ``fundamental`` is F for rays, shape (3, 3); ``confidence`` of the
    cheirality vote runs from 0 to 1; ``covariance`` of (psi, phi) has shape (2, 2) [rad^2], nan
    where the estimator has none. ``attitude`` is the camera's as estimated. ``alternative`` is
    another geometry that fits nearly as well, as there is one wherever a plane dominates the
    scene. ``jump`` is by how much tilt and roll differ between the views [rad].
    """

    bearings: Bearings
    fundamental: FloatArray
    inliers: BoolArray
    confidence: float
    covariance: FloatArray
    attitude: Attitude | None = None
    alternative: Bearings | None = None
    jump: float = 0.0
    lens: Lens = CALIBRATED
    lens_covariance: FloatArray | None = None

    @property
    def whole_covariance(self) -> FloatArray:
        """Covariance of (psi, phi) with a lens that is not known, shape (2, 2) [rad^2]."""
        if self.lens_covariance is None:
            return self.covariance
        return self.covariance + self.lens_covariance


UNKNOWN_COVARIANCE = np.full((2, 2), np.nan)


class Estimator(Protocol):
    """Matches in, bearings out; random choices come from ``rng`` alone."""

    def __call__(
        self,
        current: FloatArray,
        desired: FloatArray,
        *,
        noise: FloatArray | float,
        prior: Prior,
        rng: np.random.Generator,
    ) -> Estimate:
        """
        Estimate the bearings from matches.

        Parameters
        ----------
        current, desired : arrays, shape (N, 3)
            Unit rays; those behind the camera (z < 0) count like any other.
        noise : float or array, shape (N, 2)
            Standard deviation of the angle of a ray, along either of two axes across it [rad]:
            that of each current and desired ray, or one number for all. Of tracked pixels it is
            their noise [px] times ``Camera.resolution`` [rad].
        prior : Prior
            What is known before.
        rng : Generator
            Source of all random choices.

        Raises
        ------
        DegenerateGeometryError
            When the matches cannot answer.

        """
