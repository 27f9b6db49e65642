"""What driving teaches: by how much the robot turns by itself, and how fast D changes."""

from dataclasses import dataclass, replace
import math

from visual_servo_epipolar.core.geometry.motion import Twist
from visual_servo_epipolar.core.perception.measurement import Measurement

LATENCY_S = 0.2  # from a command to what the next image shows of it
UNREST_DECAY = 0.5  # in one frame
LEAST_HEADING_VARIANCE = 5e-4**2  # [rad^2]
FIRST_VARIANCE = 0.05**2  # of the curvature: 3 deg/m [rad^2/m^2]
LEAST_WAY = 1e-9  # from which D may show a slope; its square must not vanish [m]
SLOPE_WAY = 0.5  # over which the past is forgotten [m]


@dataclass(frozen=True, slots=True)
class Curvature:
    """
    The turn that the robot adds by itself, ``value`` [rad/m] with its ``variance``.

    ``unrest`` is how much the angular velocity changed lately, ``last_angular`` that before the
    last [rad/s].
    """

    value: float = 0.0
    variance: float = FIRST_VARIANCE
    unrest: float = 0.0
    last_angular: float = 0.0

    def learnt(
        self,
        before: Measurement | None,
        measurement: Measurement,
        twist: Twist,
        dt: float,
        *,
        drift: float,
    ) -> 'Curvature':
        """
        Return what ``twist`` for ``dt`` [s] between two sights teaches: a scalar Kalman filter.

        ``drift`` is the change of the curvature in a metre [rad/m]. The command reaches the wheels
        late by an unknown part of LATENCY_S, so that a change of the angular velocity is as good
        as noise in the heading.
        """
        unrest = max(abs(twist.angular - self.last_angular), UNREST_DECAY * self.unrest)
        if before is None or before.bearings is None or measurement.bearings is None or dt == 0.0:
            return replace(self, unrest=unrest, last_angular=twist.angular)
        way = twist.linear * dt
        turned = math.remainder(measurement.heading_error - before.heading_error, 2.0 * math.pi)
        surplus = turned - twist.angular * dt - self.value * way
        variance = self.variance + drift**2 * abs(way)
        noise = (
            (LATENCY_S * unrest) ** 2 + _heading_variance(before) + _heading_variance(measurement)
        )
        gain = variance * way / (variance * way * way + noise)
        return Curvature(
            self.value + gain * surplus, variance * (1.0 - gain * way), unrest, twist.angular
        )


@dataclass(frozen=True, slots=True)
class Slope:
    """dD/dy, ``value`` [1/m], by least squares; ``weight`` is the squared way behind it [m^2]."""

    value: float = math.nan
    weight: float = 0.0

    def learnt(self, change: float, way: float) -> 'Slope':
        """Return the slope after D changed by ``change`` over ``way`` [m]."""
        if not math.isfinite(change) or abs(way) < LEAST_WAY:
            return self
        weight = self.weight * math.exp(-abs(way) / SLOPE_WAY) + way * way
        value = 0.0 if math.isnan(self.value) else self.value
        return Slope(value + way * (change - value * way) / weight, weight)


def _heading_variance(measurement: Measurement) -> float:
    """Return the variance of alpha = psi - phi - pi/2 [rad^2], never too good to be true."""
    (psi, both), (_, phi) = measurement.covariance.tolist()
    variance = psi + phi - 2.0 * both
    return LEAST_HEADING_VARIANCE if math.isnan(variance) else variance + LEAST_HEADING_VARIANCE
