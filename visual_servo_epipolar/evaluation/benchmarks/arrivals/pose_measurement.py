"""Relative pose up to scale, from the measurements of our perception."""

from dataclasses import dataclass, replace
import math

import numpy as np

from visual_servo_epipolar.core.arrays import FloatArray
from visual_servo_epipolar.core.geometry.epipolar import Bearings, rotation_desired_current
from visual_servo_epipolar.core.geometry.motion import HALF_PI
from visual_servo_epipolar.core.geometry.rays import image_points
from visual_servo_epipolar.core.perception.measurement import Measurement
from visual_servo_epipolar.core.perception.measures import turned
from visual_servo_epipolar.core.perception.observation import Observation


@dataclass(frozen=True, slots=True)
class RelativePose:
    """
    Pose of the robot from two views: its place in units of the depth of the scene, its heading.

    ``distance`` is d / Z, Z the harmonic mean of the depths of the features from the goal, and
    ``psi`` its direction [rad]; ``heading_error`` is theta - pi/2 [rad].
    """

    distance: float
    psi: float
    heading_error: float

    @property
    def ahead(self) -> float:
        """The goal's place in the robot's frame, forward, in units of Z."""
        return -self.distance * math.cos(self.psi - self.heading_error - HALF_PI)

    @property
    def left(self) -> float:
        """The goal's place in the robot's frame, to the left, in units of Z."""
        return -self.distance * math.sin(self.psi - self.heading_error - HALF_PI)


def relative_pose(measurement: Measurement, observation: Observation) -> RelativePose:
    """Return the pose up to scale; close to the goal, without bearings, to first order."""
    bearings, desired = measurement.bearings, image_points(observation.desired)
    if bearings is None:
        rotation = rotation_desired_current(measurement.heading_error)
        close = nearby_pose(image_points(turned(observation.current, rotation)), desired)
        return replace(close, heading_error=close.heading_error + measurement.heading_error)
    scale = relative_distance(image_points(observation.current), desired, bearings)
    return RelativePose(scale, bearings.psi, bearings.heading_error)


def nearby_pose(current: FloatArray, desired: FloatArray) -> RelativePose:
    """
    Return the pose up to scale from rays, shape (N, 2) each, where it is nearly the goal's.

    All features are taken to be at depth Z: a bias in proportion to the distance, which is to
    become zero. Least squares over x, y, both by Z, and the heading error, with one reweighting.
    """
    u, v = desired.T
    none, one = np.zeros_like(u), np.ones_like(u)
    rows = np.concatenate(
        [np.stack([-one, u, 1.0 + u * u], axis=1), np.stack([none, v, u * v], axis=1)]
    )
    error = (current - desired).T.reshape(-1)
    weights: FloatArray = np.ones(len(error))
    solution: FloatArray = np.zeros(3)
    for _ in range(2):
        fit = np.linalg.lstsq(rows * weights[:, None], error * weights, rcond=None)
        solution = np.asarray(fit[0], dtype=np.float64)
        residual = np.abs(error - rows @ solution)
        weights = 1.0 / (1.0 + (residual / (3.0 * np.median(residual) + 1e-12)) ** 2)
    x, y, heading = (float(value) for value in solution)
    return RelativePose(math.hypot(x, y), math.atan2(y, x), heading)


def relative_distance(current: FloatArray, desired: FloatArray, bearings: Bearings) -> float:
    """
    Return d / Z from rays, shape (N, 2): the parallax that the features show, by least squares.

    With h the horizontal rays in the goal's axes and c the unit vector of psi, a feature at depth
    Z has h_d x h_a = (d / Z) c x h_a: one line through zero, robust by its weights.
    """
    alpha = bearings.heading_error
    cosine, sine = math.cos(alpha), math.sin(alpha)
    x = cosine * current[:, 0] - sine
    z = sine * current[:, 0] + cosine
    parallax = desired[:, 0] * z - x
    whole = math.cos(bearings.psi) * z - math.sin(bearings.psi) * x
    weights, scale = np.ones(len(x)), 0.0
    for _ in range(3):
        scale = float((weights * parallax * whole).sum() / (weights * whole**2).sum())
        residual = np.abs(parallax - scale * whole)
        weights = 1.0 / (1.0 + (residual / (3.0 * np.median(residual) + 1e-12)) ** 2)
    return max(scale, 0.0)
