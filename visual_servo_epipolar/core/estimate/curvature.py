"""Curvature that the base adds to commands, learnt while driving."""

from dataclasses import dataclass
import math

from visual_servo_epipolar.core.estimate.physical import MOST_CURVATURE
from visual_servo_epipolar.core.geometry.motion import Twist
from visual_servo_epipolar.core.perception.measurement import Measurement

LATENCY_S = 0.2  # from a command to the image that shows its effect
CHANGE_DECAY = 0.5  # of a change of the angular velocity, in one frame
LEAST_HEADING_VARIANCE = 5e-4**2  # [rad^2]
NOISE_OF_PARALLAX = 2.0  # that it is at most without any, in deviations of a coordinate
FIRST_VARIANCE = 0.05**2  # of the curvature: 3 deg/m [rad^2/m^2]


@dataclass(frozen=True, slots=True)
class Curvature:
    """
    Curvature that the base adds to every command: ``value`` [rad/m] and ``variance`` [rad^2/m^2].

    ``change`` is the largest recent change of the angular velocity, decayed, and ``last_angular``
    the angular velocity commanded last [rad/s].
    """

    value: float = 0.0
    variance: float = FIRST_VARIANCE
    change: float = 0.0
    last_angular: float = 0.0

    def updated(
        self,
        previous: Measurement | None,
        measurement: Measurement,
        twist: Twist,
        dt: float,
        *,
        drift: float,
    ) -> 'Curvature':
        """
        Return the curvature after ``twist`` for ``dt`` [s]: one step of a scalar Kalman filter.

        The state c is a random walk of ``drift`` [rad/m] in a metre. With s = u_1 dt the turn of
        the heading between the measurements is u_2 dt + c s + noise. A command reaches the wheels
        late by an unknown part of LATENCY_S, so that a change of u_2 counts as heading noise.
        """
        change = max(abs(twist.angular - self.last_angular), CHANGE_DECAY * self.change)
        driven = dt != 0.0 and measurement.bearings is not None
        if previous is None or previous.bearings is None or not driven:
            return Curvature(self.value, self.variance, change, twist.angular)
        travel = twist.linear * dt
        turn = math.remainder(measurement.heading_error - previous.heading_error, 2.0 * math.pi)
        innovation = turn - twist.angular * dt - self.value * travel
        variance = self.variance + drift**2 * abs(travel)
        late = (LATENCY_S * change) ** 2
        noise = late + _heading_noise(previous) + _heading_noise(measurement)
        gain = variance * travel / (variance * travel * travel + noise)
        value = min(max(self.value + gain * innovation, -MOST_CURVATURE), MOST_CURVATURE)
        return Curvature(value, variance * (1.0 - gain * travel), change, twist.angular)


def heading_deviation(measurement: Measurement) -> float:
    """Return the deviation of the heading error by a memory, or by two views [rad]; or inf."""
    if math.isfinite(measurement.heading_deviation):
        return measurement.heading_deviation
    if measurement.bearings is not None:
        return math.sqrt(max(heading_variance(measurement), LEAST_HEADING_VARIANCE))
    if math.isnan(measurement.parallax):
        return math.inf
    # A rotation alone takes for a turn what is parallax, but for the noise in it.
    parallax = measurement.parallax - NOISE_OF_PARALLAX * measurement.noise
    return max(parallax, math.sqrt(LEAST_HEADING_VARIANCE))


def heading_variance(measurement: Measurement) -> float:
    """Return the variance of alpha = psi - phi - pi/2 by two views [rad^2]; nan while unknown."""
    (psi, psi_phi), (_, phi) = measurement.covariance.tolist()
    return float(psi + phi - 2.0 * psi_phi)


def _heading_noise(measurement: Measurement) -> float:
    """Return the variance of a heading [rad^2], never below the least, which stands for nan."""
    variance = heading_variance(measurement)
    return LEAST_HEADING_VARIANCE if math.isnan(variance) else variance + LEAST_HEADING_VARIANCE
